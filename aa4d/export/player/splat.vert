#version 300 es
// A Gaussian as a quad around the ellipse in which it is seen: EWA splatting with the rules of docs/rasteriser.md.
precision highp float;
precision highp int;
precision highp usampler2D;

uniform usampler2D uPlaceA, uPlaceB, uShapeA, uShapeB;  // of the keys before and after: see scene.js
uniform usampler2D uOrder;  // which Gaussian, from far to near
uniform int uCount, uQuads;  // Gaussians in the order; quads of an instance
uniform float uFraction;  // of the way from key A to key B
uniform mat4 uView;  // world to camera: x right, y down, z forward
uniform vec2 uFocal, uCenter, uSize;  // pixels
uniform float uNear, uDilation, uMargin, uFaintest, uScaleStep;

flat out vec3 vColor;
flat out float vLogOpacity;  // to base 2
out vec2 vAt;  // its squared length is the Gaussian's exponent, to base 2

const float HALF_LOG2_E = 0.7213475204444817;

vec4 bytes(uint word) {
  return vec4(word & 255u, (word >> 8) & 255u, (word >> 16) & 255u, word >> 24);
}

vec4 signedBytes(uint word) {
  return vec4(ivec4(int(word) << 24, int(word) << 16, int(word) << 8, int(word)) >> 24);
}

vec3 tens(uint word) {
  return vec3(word & 1023u, (word >> 10) & 1023u, word >> 20) - 512.0;
}

void main() {
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // outside: not drawn
  vColor = vec3(0.0);
  vLogOpacity = 0.0;
  vAt = vec2(0.0);
  int slot = gl_InstanceID * uQuads + (gl_VertexID >> 2);
  if (slot >= uCount) return;
  int id = int(texelFetch(uOrder, ivec2(slot & 2047, slot >> 11), 0).x);
  ivec2 at = ivec2(id & 2047, id >> 11);
  uvec4 placeA = texelFetch(uPlaceA, at, 0), placeB = texelFetch(uPlaceB, at, 0);
  vec4 color = mix(bytes(placeA.w), bytes(placeB.w), uFraction) / 255.0;
  vec3 world = mix(uintBitsToFloat(placeA.xyz), uintBitsToFloat(placeB.xyz), uFraction);
  vec3 p = (uView * vec4(world, 1.0)).xyz;
  if (p.z < uNear || color.a < uFaintest) return;

  uvec2 shapeA = texelFetch(uShapeA, at, 0).xy, shapeB = texelFetch(uShapeB, at, 0).xy;
  vec4 q = normalize(mix(signedBytes(shapeA.x), signedBytes(shapeB.x), uFraction));
  vec3 scale = exp(mix(tens(shapeA.y), tens(shapeB.y), uFraction) * uScaleStep);
  float w = q.x, x = q.y, y = q.z, z = q.w;
  mat3 turn = mat3(uView) * mat3(
    1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
    2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
    2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));

  // The perspective's Jacobian follows x / z and y / z a little beyond the picture, no farther.
  vec2 slope = p.xy / p.z, margin = uMargin * 0.5 * uSize / uFocal;
  vec2 held = clamp(slope, -uCenter / uFocal - margin, (uSize - uCenter) / uFocal + margin);
  vec3 depths = vec3(turn[0].z, turn[1].z, turn[2].z);
  vec3 across = uFocal.x / p.z * (vec3(turn[0].x, turn[1].x, turn[2].x) - held.x * depths) * scale;
  vec3 down = uFocal.y / p.z * (vec3(turn[0].y, turn[1].y, turn[2].y) - held.y * depths) * scale;
  float a = dot(across, across) + uDilation, b = dot(across, down), c = dot(down, down) + uDilation;

  float middle = 0.5 * (a + c), spread = length(vec2(0.5 * (a - c), b));
  float larger = middle + spread, smaller = max(middle - spread, uDilation);
  vec2 axis = vec2(1.0, 0.0);
  if (spread > 1e-6 * middle) axis = normalize(a > c ? vec2(larger - c, b) : vec2(b, larger - a));
  float reach = sqrt(2.0 * log(color.a / uFaintest));  // standard deviations to where alpha falls to the cut-off
  vec2 corner = 2.0 * vec2(gl_VertexID & 1, (gl_VertexID >> 1) & 1) - 1.0;
  vec2 offset = corner.x * sqrt(larger) * axis + corner.y * sqrt(smaller) * vec2(-axis.y, axis.x);
  vec2 pixel = uFocal * slope + uCenter + reach * offset;

  vColor = color.rgb;
  vLogOpacity = log2(color.a);
  vAt = corner * reach * sqrt(HALF_LOG2_E);
  gl_Position = vec4(2.0 * pixel / uSize - 1.0, 0.0, 1.0) * vec4(1.0, -1.0, 1.0, 1.0);
}
