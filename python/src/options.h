// SPDX-License-Identifier: Apache-2.0
// Options structs as Python classes: names, defaults, ranges and help texts are those of describe()
// (core/types/options.h). An argument that takes options accepts an object of the class or a dict.
#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "python/src/casters.h"

namespace fringeslam::python {

// One field of an options struct.
struct OptionField {
  std::string name, type, help;
};

// Lists the fields of an options struct.
class FieldLister {
 public:
  explicit FieldLister(std::vector<OptionField>& fields) : fields_(fields) {}
  void field(const char* name, double&, Range range, const char* help) { add(name, "float", help, range); }
  void field(const char* name, int&, Range range, const char* help) { add(name, "int", help, range); }
  void field(const char* name, bool&, const char* help) { fields_.push_back({name, "bool", help}); }
  template <NamedEnum E>
  void field(const char* name, E&, const char* help) {
    std::string choices;
    for (const std::string& choice : choice_names<E>()) choices += (choices.empty() ? "" : ", ") + choice;
    fields_.push_back({name, "str", std::string(help) + " (one of " + choices + ")"});
  }

 private:
  void add(const char* name, const char* type, const char* help, Range range) {
    fields_.push_back({name, type, std::string(help) + " (" + to_text(range.low) + " to " + to_text(range.high) + ")"});
  }
  std::vector<OptionField>& fields_;
};

// Reads one field.
class FieldReader {
 public:
  explicit FieldReader(std::string name) : name_(std::move(name)) {}
  template <class T>
  void field(const char* name, T& value, Range, const char*) {
    field(name, value, "");
  }
  template <class T>
  void field(const char* name, T& value, const char*) {
    if (name == name_) result = py::cast(value);
  }
  py::object result;

 private:
  std::string name_;
};

// Assigns one field. Throws Error if the value has the wrong type or is out of range.
class FieldWriter {
 public:
  FieldWriter(std::string prefix, std::string name, py::handle value)
      : prefix_(std::move(prefix)), name_(std::move(name)), value_(value) {}
  void field(const char* name, double& field, Range range, const char*) {
    if (name == name_) field = in_range(number(), range);
  }
  void field(const char* name, int& field, Range range, const char*) {
    if (name != name_) return;
    const double value = in_range(number(), range);
    if (value != std::floor(value)) throw Error(full_name() + " must be a whole number, not " + text());
    field = static_cast<int>(value);
  }
  void field(const char* name, bool& field, const char*) {
    if (name != name_) return;
    if (!py::isinstance<py::bool_>(value_)) throw Error(full_name() + " must be True or False, not " + text());
    field = value_.cast<bool>();
  }
  template <NamedEnum E>
  void field(const char* name, E& field, const char*) {
    if (name != name_) return;
    if (!py::isinstance<py::str>(value_)) throw Error(full_name() + " must be a string, not " + text());
    try {
      field = value_.cast<E>();
    } catch (const Error& e) {
      throw Error(full_name() + ": " + e.what());
    }
  }

 private:
  std::string full_name() const { return prefix_ + "." + name_; }
  std::string text() const { return std::string(py::repr(value_)); }
  double number() const {
    if (py::isinstance<py::bool_>(value_) || !PyNumber_Check(value_.ptr()) || py::isinstance<py::array>(value_))
      throw Error(full_name() + " must be a number, not " + text());
    return py::float_(py::reinterpret_borrow<py::object>(value_));
  }
  double in_range(double value, Range range) const {
    if (!range.contains(value)) throw Error(range_error(full_name(), value, range));
    return value;
  }
  std::string prefix_, name_;
  py::handle value_;
};

template <class Options>
std::vector<OptionField> fields_of() {
  std::vector<OptionField> fields;
  FieldLister lister(fields);
  Options().describe(lister);
  return fields;
}

// Assigns the values of a dict. Throws Error naming the nearest known key for an unknown one.
template <class Options>
void assign(Options& options, const std::string& prefix, const py::dict& values) {
  const std::vector<OptionField> fields = fields_of<Options>();
  for (const std::pair<py::handle, py::handle> value : values) {
    const std::string name = py::str(value.first);
    std::vector<std::string> names;
    for (const OptionField& field : fields) names.push_back(field.name);
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      const std::string nearest = nearest_name(name, names);
      throw Error("unknown option '" + prefix + "." + name + "'" +
                  (nearest.empty() ? "" : "; did you mean '" + nearest + "'?"));
    }
    FieldWriter writer(prefix, name, value.second);
    options.describe(writer);
  }
}

template <class Options>
py::dict dict_of(const Options& options) {
  py::dict values;
  for (const OptionField& field : fields_of<Options>()) {
    FieldReader reader(field.name);
    const_cast<Options&>(options).describe(reader);
    values[py::str(field.name)] = reader.result;
  }
  return values;
}

// Returns the options that a Python argument means: an object of the options' class, a dict, or None for the defaults;
// then changed by keyword arguments.
template <class Options>
Options options_of(const std::string& prefix, const py::object& given, const py::dict& changes = {}) {
  Options options;
  if (py::isinstance<Options>(given)) {
    options = given.cast<Options>();
  } else if (py::isinstance<py::dict>(given)) {
    assign(options, prefix, given);
  } else if (!given.is_none()) {
    throw py::type_error("expected " + std::string(py::str(py::type::of<Options>().attr("__name__"))) +
                         ", a dict or None, not " + type_name(given));
  }
  assign(options, prefix, changes);
  return options;
}

// Binds an options struct; `prefix` is the name of the stage in messages and settings.
template <class Options>
py::class_<Options> bind_options(py::module_& m, const char* name, const std::string& prefix, const std::string& doc) {
  std::string text = doc + "\n";
  const py::dict defaults = dict_of(Options());
  for (const OptionField& field : fields_of<Options>())
    text += "\n" + field.name + ": " + field.help + "; default " + std::string(py::str(defaults[py::str(field.name)]));
  py::class_<Options> cls(m, name, text.c_str());
  cls.def(py::init([prefix](const py::kwargs& values) { return options_of<Options>(prefix, py::none(), values); }));
  for (const OptionField& field : fields_of<Options>()) {
    const auto get = [name = field.name](const Options& options) {
      FieldReader reader(name);
      const_cast<Options&>(options).describe(reader);
      return reader.result;
    };
    const auto set = [prefix, name = field.name](Options& options, const py::object& value) {
      FieldWriter writer(prefix, name, value);
      options.describe(writer);
    };
    cls.def_property(field.name.c_str(), get, set, (field.type + ": " + field.help).c_str());
  }
  cls.def("to_dict", &dict_of<Options>, "Returns all values by name.");
  cls.def("__repr__", [cls_name = std::string(name)](const Options& options) {
    std::string values;
    for (const std::pair<py::handle, py::handle> value : dict_of(options))
      values +=
          (values.empty() ? "" : ", ") + std::string(py::str(value.first)) + "=" + std::string(py::repr(value.second));
    return cls_name + "(" + values + ")";
  });
  cls.def("__eq__", [](const Options& a, const Options& b) { return dict_of(a).equal(dict_of(b)); });
  cls.def(py::pickle([](const Options& options) { return dict_of(options); },
                     [prefix](const py::dict& values) { return options_of<Options>(prefix, values); }));
  return cls;
}

}  // namespace fringeslam::python
