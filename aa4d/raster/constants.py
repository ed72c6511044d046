"""Constants of the rasteriser (those of gsplat). A test holds them to aa4d/_native/raster/constants.hpp."""

DILATION = 0.3  # added to both diagonals of the projected covariance, px^2 (EWA's low-pass filter)
MAX_ALPHA = 0.99  # keeps 1 - alpha away from zero; no gradient passes where it binds
FRUSTUM_MARGIN = 0.3  # how far outside the image, in half fields of view, the Jacobian follows x / z
MIN_QUATERNION_NORM = 1e-12  # a shorter quaternion turns less and less: zero means no rotation
MIN_COMPENSATION = 0.005  # factor of opacity, in the antialiased mode
MAX_FEATURES = 32  # channels beside colour and depth
MAX_SIDE = 1 << 20  # pixels of an image, along each side
