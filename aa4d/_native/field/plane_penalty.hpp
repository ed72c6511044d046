#pragma once

#include <cstddef>

#include "field/kernels.hpp"

namespace aa4d::field {

// The sum of several planes' penalties, added up in their order and row by row.
double penalise_planes(const Penalty* penalties, std::size_t count, int threads);

}  // namespace aa4d::field
