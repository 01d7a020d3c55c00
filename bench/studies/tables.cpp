// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/tables.h"

#include <sqlite3.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/types/error.h"

namespace fringeslam::studies {

namespace fs = std::filesystem;

namespace {

using Json = nlohmann::ordered_json;

// A flat table: missing values are empty.
struct Table {
  std::vector<std::string> columns;
  std::vector<std::vector<Json>> rows;
};

Table table_of(const Study& study, const std::map<int, std::string>& lines) {
  Table table;
  table.columns.assign(kOwnColumns.begin(), kOwnColumns.end());
  const size_t own = table.columns.size();
  for (const Parameter& parameter : study.parameters) table.columns.push_back(parameter.name);
  std::vector<Json> parsed;
  for (const auto& [trial, line] : lines) {
    parsed.push_back(Json::parse(line));
    if (!parsed.back().contains("metrics")) continue;
    for (const auto& [name, value] : parsed.back()["metrics"].items()) {
      if (std::find(table.columns.begin(), table.columns.end(), name) == table.columns.end())
        table.columns.push_back(name);
    }
  }
  for (const Json& line : parsed) {
    std::vector<Json> row;
    for (size_t c = 0; c < table.columns.size(); ++c) {
      const std::string& column = table.columns[c];
      const bool parameter = c >= own && c < own + study.parameters.size();
      const Json& from = c < own                    ? line
                         : parameter                ? line.at("values")
                         : line.contains("metrics") ? line["metrics"]
                                                    : line;
      Json value = from.contains(column) ? from[column] : Json();
      // Values are YAML: stored as numbers where they are numeric.
      if (parameter) {
        const Json number = Json::parse(value.get<std::string>(), nullptr, false);
        if (number.is_number()) value = number;
      }
      row.push_back(std::move(value));
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

std::string csv_field(const Json& value) {
  if (value.is_null()) return "";
  const std::string text = value.is_string() ? value.get<std::string>() : json_text(value);
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

std::string csv_of(const Table& table) {
  std::string text;
  const auto line = [&](const auto& fields, const auto& field) {
    for (size_t i = 0; i < fields.size(); ++i) text += (i > 0 ? "," : "") + field(fields[i]);
    text += "\n";
  };
  line(table.columns, [](const std::string& name) { return csv_field(name); });
  for (const auto& row : table.rows) line(row, csv_field);
  return text;
}

std::string sql_name(const std::string& name) {
  std::string quoted = "\"";
  for (const char c : name) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

void write_sqlite(const fs::path& file, const Table& table) {
  sqlite3* opened = nullptr;
  const int failure = sqlite3_open(file.c_str(), &opened);
  const std::unique_ptr<sqlite3, decltype(&sqlite3_close)> database(opened, &sqlite3_close);
  const auto check = [&](int code) {
    if (code != SQLITE_OK && code != SQLITE_DONE && code != SQLITE_ROW)
      throw Error(file.string() + ": " + sqlite3_errmsg(database.get()));
  };
  check(failure);
  const auto execute = [&](const std::string& sql) {
    check(sqlite3_exec(database.get(), sql.c_str(), nullptr, nullptr, nullptr));
  };
  std::string columns, places;
  for (size_t i = 0; i < table.columns.size(); ++i) {
    columns += (i > 0 ? ", " : "") + sql_name(table.columns[i]) + (i == 0 ? " INTEGER PRIMARY KEY" : "");
    places += i > 0 ? ", ?" : "?";
  }
  execute("CREATE TABLE trials (" + columns + ")");
  execute("BEGIN");
  sqlite3_stmt* prepared = nullptr;
  check(sqlite3_prepare_v2(database.get(), ("INSERT INTO trials VALUES (" + places + ")").c_str(), -1, &prepared,
                           nullptr));
  const std::unique_ptr<sqlite3_stmt, decltype(&sqlite3_finalize)> insert(prepared, &sqlite3_finalize);
  for (const auto& row : table.rows) {
    for (size_t i = 0; i < row.size(); ++i) {
      const int place = static_cast<int>(i) + 1;
      if (row[i].is_null())
        check(sqlite3_bind_null(insert.get(), place));
      else if (row[i].is_number_integer())
        check(sqlite3_bind_int64(insert.get(), place, row[i].get<int64_t>()));
      else if (row[i].is_number())
        check(sqlite3_bind_double(insert.get(), place, row[i].get<double>()));
      else
        check(sqlite3_bind_text(insert.get(), place, row[i].get<std::string>().c_str(), -1, SQLITE_TRANSIENT));
    }
    check(sqlite3_step(insert.get()));
    check(sqlite3_reset(insert.get()));
  }
  execute("COMMIT");
}

}  // namespace

void write_tables(const fs::path& folder, const Study& study, const std::map<int, std::string>& lines) {
  std::string all;
  for (const auto& [trial, line] : lines) all += line + "\n";
  const Table table = table_of(study, lines);
  StagedFile jsonl(folder / "results.jsonl"), csv(folder / "results.csv"), sqlite(folder / "results.sqlite");
  write_text(jsonl.path(), all);
  write_text(csv.path(), csv_of(table));
  write_sqlite(sqlite.path(), table);
  for (StagedFile* file : {&jsonl, &csv, &sqlite}) file->commit();
}

}  // namespace fringeslam::studies
