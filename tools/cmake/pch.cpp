// SPDX-License-Identifier: Apache-2.0
// Carries the precompiled headers, which CMake attaches to a target with at least one source.
