// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/mapper/pipeline.h"
#include "python/src/casters.h"

namespace fringeslam::python {

// Returns the options that a Python argument means: PipelineOptions, a dict of stages, or None for the defaults; then
// changed by `changes`, stage by stage. Throws Error for unknown stages and options.
PipelineOptions pipeline_options_of(const py::object& given, const py::dict& changes = {});

}  // namespace fringeslam::python
