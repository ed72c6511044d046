#version 300 es
precision highp float;

uniform float uFaintest, uMaxAlpha;
flat in vec3 vColor;
flat in float vLogOpacity;
in vec2 vAt;
out vec4 color;  // premultiplied

void main() {
  float alpha = exp2(vLogOpacity - dot(vAt, vAt));
  if (alpha < uFaintest) discard;
  alpha = min(alpha, uMaxAlpha);
  color = vec4(vColor * alpha, alpha);
}
