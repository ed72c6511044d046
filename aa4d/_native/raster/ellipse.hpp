// Which rectangles an ellipse touches: one lane for each rectangle.
#pragma once

#include "raster/simd.hpp"

namespace aa4d::raster::AA4D_ARCH {

// u^2 + w^2 <= reach around the origin, with u = l11 x + l21 y and w = l22 y.
class Ellipse {
 public:
  Ellipse(Float l11, Float l21, Float l22, float reach)
      : l11_(l11),
        l21_(l21),
        l22_(l22),
        best_y_(Float(0.0f) - l11 * l21 * reciprocal(fma(l21, l21, l22 * l22))),
        best_x_(Float(0.0f) - l21 * reciprocal(l11)),
        limit_(reach * 1.001f + 0.001f) {}  // for rounding: nothing is lost

  // The smallest u^2 + w^2 over a rectangle lies on a side that faces the origin: on the vertical one, at the best y
  // for its x, or on the horizontal one, at the best x for its y.
  Mask touches(Float x_first, Float x_last, Float y_first, Float y_last) const {
    const Float zero(0.0f);
    const Float x_side = max(x_first, min(zero, x_last)), y_side = max(y_first, min(zero, y_last));
    const Float y_on = max(y_first, min(best_y_ * x_side, y_last));
    const Float x_on = max(x_first, min(best_x_ * y_side, x_last));
    const Float u_a = fma(l11_, x_side, l21_ * y_on), w_a = l22_ * y_on;
    const Float u_b = fma(l11_, x_on, l21_ * y_side), w_b = l22_ * y_side;
    return min(fma(u_a, u_a, w_a * w_a), fma(u_b, u_b, w_b * w_b)) <= limit_;
  }

 private:
  Float l11_, l21_, l22_;
  Float best_y_, best_x_;  // the best y for an x, and x for a y
  Float limit_;
};

}  // namespace aa4d::raster::AA4D_ARCH
