// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/summary.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "bench/studies/rows.h"
#include "core/base/constants.h"
#include "core/score/score.h"
#include "core/types/options.h"

namespace fringeslam::studies {

namespace {

constexpr int kClasses = 8;

std::vector<const Row*> pointers_to(const std::vector<Row>& rows) {
  std::vector<const Row*> pointers;
  for (const Row& row : rows) pointers.push_back(&row);
  return pointers;
}

// Trials with values of their own: a saltelli design repeats those of the first two trials of each row in the others.
bool is_independent(const Study& study, const Row& row) {
  return study.design != Design::saltelli || row.trial % row_length(study) < 2;
}

// Returns the 95 % interval of the probability of success, by the independent ones among the trials.
Interval success_interval(const Study& study, const std::vector<const Row*>& rows) {
  int successes = 0, trials = 0;
  for (const Row* row : rows) {
    if (!is_independent(study, *row)) continue;
    ++trials;
    successes += row->success;
  }
  return wilson(successes, trials);
}

void close(const Study& study, Class& of, const std::vector<const Row*>& rows) {
  std::vector<double> errors;
  for (const Row* row : rows) {
    ++of.trials;
    of.successes += row->success;
    if (std::isfinite(row->translation_mm)) errors.push_back(row->translation_mm);
  }
  of.rate_95 = success_interval(study, rows);
  of.median_mm = errors.empty() ? kNaN : quantile_of(errors, 0.5);
  of.p90_mm = errors.empty() ? kNaN : quantile_of(errors, 0.9);
}

std::vector<Class> classes_of(const Study& study, size_t p, const std::vector<Row>& rows) {
  const Parameter& parameter = study.parameters[p];
  std::vector<Class> classes;
  if (!parameter.values.empty()) {
    for (const std::string& value : parameter.values) {
      std::vector<const Row*> inside;
      for (const Row& row : rows) {
        if (row.values[p] == value) inside.push_back(&row);
      }
      classes.push_back({.label = value, .rate_95 = {}});
      close(study, classes.back(), inside);
    }
    return classes;
  }
  // Classes of equal size, so that none is too small for statistics.
  std::vector<const Row*> order = pointers_to(rows);
  std::sort(order.begin(), order.end(), [&](const Row* a, const Row* b) { return a->numbers[p] < b->numbers[p]; });
  for (size_t c = 0; c < kClasses; ++c) {
    const std::vector<const Row*> inside(order.begin() + static_cast<long>(c * order.size() / kClasses),
                                         order.begin() + static_cast<long>((c + 1) * order.size() / kClasses));
    if (inside.empty()) continue;
    classes.push_back(
        {.label = "", .low = inside.front()->numbers[p], .high = inside.back()->numbers[p], .rate_95 = {}});
    close(study, classes.back(), inside);
  }
  return classes;
}

// Sensitivities of an output; rows without a value are left out.
template <class Output>
SobolIndex sensitivity(const Study& study, size_t p, const std::vector<Row>& rows, const Output& output) {
  if (study.design == Design::saltelli) {
    const auto length = static_cast<size_t>(row_length(study));
    std::vector<double> a, b, a_with_b;
    for (size_t begin = 0; begin + length <= rows.size(); ++begin) {
      if (rows[begin].trial % static_cast<int>(length) != 0 ||
          rows[begin + length - 1].trial != rows[begin].trial + static_cast<int>(length) - 1)
        continue;  // not the beginning of a row, or one of its trials is missing
      const double of_a = output(rows[begin]), of_b = output(rows[begin + 1]), of_ab = output(rows[begin + 2 + p]);
      if (!std::isfinite(of_a + of_b + of_ab)) continue;
      a.push_back(of_a), b.push_back(of_b), a_with_b.push_back(of_ab);
    }
    return sobol(a, b, a_with_b);
  }
  std::vector<double> in, out;
  for (const Row& row : rows) {
    const auto place = std::find(study.parameters[p].values.begin(), study.parameters[p].values.end(), row.values[p]);
    const double value = study.parameters[p].values.empty()
                             ? row.numbers[p]
                             : static_cast<double>(place - study.parameters[p].values.begin());
    if (!std::isfinite(value + output(row))) continue;
    in.push_back(value), out.push_back(output(row));
  }
  return first_order(in, out);
}

// The box of the envelope, over the numeric parameters.
struct Box {
  std::vector<double> low, high;
  bool holds(const Row& row) const {
    for (size_t p = 0; p < low.size(); ++p) {
      if (row.numbers[p] < low[p] || row.numbers[p] > high[p]) return false;
    }
    return true;
  }
};

// Splits the trials into halves that do not depend on each other: the rows of a saltelli design, whose trials share values,
// remain whole. Values of a grid follow each other, and its even and odd trials would differ in them.
bool is_in_first_half(const Row& row, const Study& study) {
  constexpr uint64_t kGoldenRatio = 0x9E3779B97F4A7C15;
  const int number = row.trial / row_length(study);
  const bool grid = std::any_of(study.parameters.begin(), study.parameters.end(),
                                [](const Parameter& parameter) { return parameter.law == Parameter::Law::grid; });
  return grid ? static_cast<uint64_t>(number) * kGoldenRatio >> 63 == 0 : number % 2 == 0;
}

void find_envelope(const Study& study, const std::vector<Row>& rows, Summary& summary) {
  constexpr double kWanted = 0.99, kPeel = 0.05;
  constexpr size_t kLeast = 30;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const size_t count = summary.parameters.size();
  std::vector<const Row*> inside, proof;
  for (const Row& row : rows) (is_in_first_half(row, study) ? inside : proof).push_back(&row);
  Box box{std::vector<double>(count, -kInfinity), std::vector<double>(count, kInfinity)};
  const auto rate = [](const std::vector<const Row*>& of) {
    return static_cast<double>(std::count_if(of.begin(), of.end(), [](const Row* row) { return row->success; })) /
           static_cast<double>(of.size());
  };
  while (!inside.empty() && rate(inside) < kWanted) {
    double best = rate(inside);
    std::optional<Box> next;
    for (size_t p = 0; p < count; ++p) {
      std::vector<double> values;
      for (const Row* row : inside) values.push_back(row->numbers[p]);
      if (!std::isfinite(values.front())) continue;
      for (const bool from_below : {true, false}) {
        Box peeled = box;
        (from_below ? peeled.low : peeled.high)[p] = quantile_of(values, from_below ? kPeel : 1 - kPeel);
        std::vector<const Row*> left;
        for (const Row* row : inside) {
          if (peeled.holds(*row)) left.push_back(row);
        }
        if (left.size() < kLeast || left.size() == inside.size() || rate(left) <= best) continue;
        best = rate(left);
        next = peeled;
      }
    }
    if (!next) return;
    box = *next;
    std::erase_if(inside, [&](const Row* row) { return !box.holds(*row); });
  }
  if (inside.size() < kLeast) return;
  summary.envelope = true;
  for (const Row* row : proof) {
    if (!box.holds(*row) || !is_independent(study, *row)) continue;
    ++summary.envelope_trials;
    summary.envelope_successes += row->success;
  }
  summary.envelope_95 = wilson(summary.envelope_successes, summary.envelope_trials);
  for (size_t p = 0; p < count; ++p)
    summary.parameters[p].safe_low = box.low[p], summary.parameters[p].safe_high = box.high[p];
}

// Failures, worst first.
std::vector<const Row*> failures_of(const std::vector<Row>& rows) {
  static const std::vector<std::string> severity = {"crashed", "timed_out",  "confidently_wrong",
                                                    "refused", "inaccurate", "lost"};
  const auto rank = [&](const Row* row) {
    return std::find(severity.begin(), severity.end(), row->outcome) - severity.begin();
  };
  std::vector<const Row*> order;
  for (const Row& row : rows) {
    if (!row.success) order.push_back(&row);
  }
  std::stable_sort(order.begin(), order.end(), [&](const Row* a, const Row* b) {
    if (rank(a) != rank(b)) return rank(a) < rank(b);
    return (std::isfinite(a->translation_mm) ? a->translation_mm : 0) >
           (std::isfinite(b->translation_mm) ? b->translation_mm : 0);
  });
  return order;
}

void find_worst(const Study& study, const std::vector<Row>& rows, int count, Summary& summary) {
  const std::vector<const Row*> order = failures_of(rows);
  const auto entry = [&](const Row* row) {
    return WorstTrial{row->trial, row->outcome, row->cause, command_of(study, trial_of(study, row->trial)),
                      row->translation_mm};
  };
  std::set<std::string> causes;
  for (const Row* row : order) {
    if (static_cast<int>(summary.worst.size()) < count) summary.worst.push_back(entry(row));
    if (causes.insert(row->cause).second) summary.worst_of_causes.push_back(entry(row));
  }
}

nlohmann::ordered_json to_json(const Interval& interval) { return {interval.low, interval.high}; }

nlohmann::ordered_json to_json(const WorstTrial& worst) {
  return {{"trial", worst.trial},
          {"outcome", worst.outcome},
          {"cause", worst.cause},
          {"translation_mm", worst.translation_mm},
          {"command", worst.command}};
}

nlohmann::ordered_json to_json(const SobolIndex& index) {
  return {{"first", index.first},
          {"first_95", to_json(index.first_95)},
          {"total", index.total},
          {"total_95", to_json(index.total_95)}};
}

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f %%", 100 * share);
  return text;
}

std::string percent(const Interval& interval) {
  return "[" + percent(interval.low) + ", " + percent(interval.high) + "]";
}

}  // namespace

Summary summarise(const Study& study, const std::map<int, std::string>& lines, int worst) {
  const std::vector<Row> rows = rows_of(study, lines);
  Summary summary;
  summary.name = study.name;
  summary.trials = static_cast<int>(rows.size());
  summary.missing = study.trials - summary.trials;
  std::vector<double> errors;
  for (const Row& row : rows) {
    summary.successes += row.success;
    ++summary.outcomes[row.outcome];
    if (!row.cause.empty()) ++summary.causes[row.cause];
    if (std::isfinite(row.translation_mm)) errors.push_back(row.translation_mm);
  }
  summary.rate_95 = success_interval(study, pointers_to(rows));
  for (const double q : {0.5, 0.9, 0.95, 0.99, 1.0}) {
    if (!errors.empty()) summary.error_percentiles_mm.emplace_back(100 * q, quantile_of(errors, q));
  }
  const auto success = [](const Row& row) { return row.success ? 1.0 : 0.0; };
  const auto log_error = [](const Row& row) { return std::log10(row.translation_mm); };
  for (size_t p = 0; p < study.parameters.size(); ++p) {
    summary.parameters.push_back({study.parameters[p].name, classes_of(study, p, rows),
                                  sensitivity(study, p, rows, success), sensitivity(study, p, rows, log_error), kNaN,
                                  kNaN});
  }
  find_envelope(study, rows, summary);
  find_worst(study, rows, worst, summary);
  return summary;
}

nlohmann::ordered_json to_json(const Summary& summary) {
  nlohmann::ordered_json json = {{"name", summary.name},
                                 {"trials", summary.trials},
                                 {"missing", summary.missing},
                                 {"successes", summary.successes},
                                 {"success_95", to_json(summary.rate_95)},
                                 {"outcomes", summary.outcomes},
                                 {"causes", summary.causes}};
  for (const auto& [percentile, error] : summary.error_percentiles_mm)
    json["translation_percentiles_mm"].push_back({percentile, error});
  for (const ParameterSummary& parameter : summary.parameters) {
    nlohmann::ordered_json entry = {{"name", parameter.name},
                                    {"of_success", to_json(parameter.of_success)},
                                    {"of_error", to_json(parameter.of_error)}};
    for (const Class& c : parameter.classes)
      entry["classes"].push_back({{"label", c.label},
                                  {"range", {c.low, c.high}},
                                  {"trials", c.trials},
                                  {"successes", c.successes},
                                  {"success_95", to_json(c.rate_95)},
                                  {"translation_median_mm", c.median_mm},
                                  {"translation_p90_mm", c.p90_mm}});
    if (summary.envelope) entry["envelope"] = {parameter.safe_low, parameter.safe_high};
    json["parameters"].push_back(entry);
  }
  if (summary.envelope)
    json["envelope"] = {{"trials", summary.envelope_trials},
                        {"successes", summary.envelope_successes},
                        {"success_95", to_json(summary.envelope_95)}};
  json["worst"] = json["worst_of_causes"] = nlohmann::ordered_json::array();
  for (const WorstTrial& worst : summary.worst) json["worst"].push_back(to_json(worst));
  for (const WorstTrial& worst : summary.worst_of_causes) json["worst_of_causes"].push_back(to_json(worst));
  return json;
}

namespace {

// Rounded for display; summary.json has all digits.
std::string rounded(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

}  // namespace

std::string to_text(const Summary& summary) {
  const double rate = summary.trials > 0 ? static_cast<double>(summary.successes) / summary.trials : 0;
  std::string text = single_line(summary.name) + ": " + std::to_string(summary.trials) + " trials, " + percent(rate) +
                     " succeed " + percent(summary.rate_95) + "\n";
  if (summary.missing > 0) text += std::to_string(summary.missing) + " trials are missing\n";
  for (const auto& [cause, count] : summary.causes) text += "  " + std::to_string(count) + " " + cause + "\n";
  text += "translation error, mm:";
  for (const auto& [percentile, error] : summary.error_percentiles_mm) {
    char part[64];
    std::snprintf(part, sizeof part, "  %g %%: %.4g", percentile, error);
    text += part;
  }
  text += "\n\nshare of the variance of success explained by a parameter alone (and including interactions)\n";
  for (const ParameterSummary& parameter : summary.parameters) {
    text += "  " + single_line(parameter.name) + ": " + percent(parameter.of_success.first) + " " +
            percent(parameter.of_success.first_95);
    if (std::isfinite(parameter.of_success.total))
      text += " (" + percent(parameter.of_success.total) + " " + percent(parameter.of_success.total_95) + ")";
    text += "\n";
    for (const Class& c : parameter.classes) {
      const std::string label = c.label.empty() ? rounded(c.low) + " to " + rounded(c.high) : single_line(c.label);
      text += "    " + label + ": " + percent(c.trials > 0 ? static_cast<double>(c.successes) / c.trials : 0) + " " +
              percent(c.rate_95) + " of " + std::to_string(c.trials) + "\n";
    }
  }
  if (!summary.envelope) return text + "\nno envelope with 99 % success was found\n";
  text +=
      "\nenvelope: " +
      percent(summary.envelope_trials > 0 ? static_cast<double>(summary.envelope_successes) / summary.envelope_trials
                                          : 0) +
      " " + percent(summary.envelope_95) + " of " + std::to_string(summary.envelope_trials) +
      " other trials succeed within\n";
  for (const ParameterSummary& parameter : summary.parameters) {
    if (std::isfinite(parameter.safe_low))
      text += "  " + single_line(parameter.name) + " >= " + rounded(parameter.safe_low) + "\n";
    if (std::isfinite(parameter.safe_high))
      text += "  " + single_line(parameter.name) + " <= " + rounded(parameter.safe_high) + "\n";
  }
  return text;
}

}  // namespace fringeslam::studies
