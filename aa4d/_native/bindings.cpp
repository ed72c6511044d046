// The Python module aa4d._native. Its two halves share one library, and with it one pool of threads.
#include <nanobind/nanobind.h>

#include "common/thread_pool.hpp"

namespace nb = nanobind;

void bind_raster(nb::module_& m);
void bind_field(nb::module_& m);

NB_MODULE(_native, m) {
  nb::set_leak_warnings(false);  // an autograd graph that is alive at exit holds its frame: no leak
  m.def("worker_count", &aa4d::worker_count);
  nb::module_ raster = m.def_submodule("raster");
  bind_raster(raster);
  nb::module_ field = m.def_submodule("field");
  bind_field(field);
}
