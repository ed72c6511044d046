// Splatting without a graphics processor: the rules of docs/rasteriser.md in plain arithmetic. Also what the graphics
// processor cannot do by itself: the order from far to near.

const BINS = 1 << 16;

// Indices of `count` depths, all positive, from far to near. Equal steps of a float's bits are equal relative ones.
function farToNear(depths, count) {
  const bits = new Uint32Array(depths.buffer, depths.byteOffset, count);
  let low = Infinity, high = 0;
  for (let i = 0; i < count; i++) {
    if (bits[i] < low) low = bits[i];
    if (bits[i] > high) high = bits[i];
  }
  const scale = (BINS - 1) / Math.max(high - low, 1);
  const starts = new Uint32Array(BINS + 1), order = new Uint32Array(count);
  for (let i = 0; i < count; i++) starts[(((high - bits[i]) * scale) | 0) + 1]++;
  for (let bin = 0; bin < BINS; bin++) starts[bin + 1] += starts[bin];
  for (let i = 0; i < count; i++) order[starts[((high - bits[i]) * scale) | 0]++] = i;
  return order;
}

// Opacity in [0, 1] on the way from one key to the next.
const opacityAt = (before, after, i, fraction) => {
  const from = before.place[4 * i + 3] >>> 24;
  return (from + fraction * ((after.place[4 * i + 3] >>> 24) - from)) / 255;
};

// Which Gaussians can be seen at all, from far to near.
function orderOf(scene, t, matrix) {
  const { header, keys } = scene;
  const [key, fraction] = bracket(header.t, t);
  const before = keys[key], after = keys[Math.min(key + 1, keys.length - 1)];
  const [x, y, z, w] = matrix.slice(8);
  const ids = new Uint32Array(header.count), depths = new Float32Array(header.count);
  let count = 0;
  for (let i = 0; i < header.count; i++) {
    if (opacityAt(before, after, i, fraction) < header.constants.faintest) continue;
    const a = before.xyz, b = after.xyz, at = 4 * i;
    const depth =
      x * (a[at] + fraction * (b[at] - a[at])) +
      y * (a[at + 1] + fraction * (b[at + 1] - a[at + 1])) +
      z * (a[at + 2] + fraction * (b[at + 2] - a[at + 2])) + w;
    if (depth < header.near) continue;
    ids[count] = i;
    depths[count++] = depth;
  }
  return farToNear(depths, count).map((rank) => ids[rank]);
}

const FIELDS = 11; // of a projected splat: see `project`

// The Gaussians that reach the picture, on the screen: {splats: FIELDS numbers each, depths, count}.
function project(scene, t, matrix, lens) {
  const { header, keys } = scene;
  const { dilation, margin, faintest } = header.constants;
  const { fx, fy, cx, cy, width, height } = lens;
  const [key, f] = bracket(header.t, t);
  const before = keys[key], after = keys[Math.min(key + 1, keys.length - 1)];
  const step = header.attributes.log_scale.step;
  const [a0, a1, a2, a3, b0, b1, b2, b3, c0, c1, c2, c3] = matrix;
  const spareX = (margin * width) / 2 / fx, spareY = (margin * height) / 2 / fy;
  const left = -cx / fx - spareX, right = (width - cx) / fx + spareX;
  const top = -cy / fy - spareY, bottom = (height - cy) / fy + spareY;
  const low = dilation * lens.blur;
  const splats = new Float64Array(header.count * FIELDS), depths = new Float32Array(header.count);
  let count = 0;
  for (let i = 0, at = 0; i < header.count; i++, at += 4) {
    const opacity = opacityAt(before, after, i, f);
    if (opacity < faintest) continue;
    const p = before.xyz, q = after.xyz;
    const X = p[at] + f * (q[at] - p[at]), Y = p[at + 1] + f * (q[at + 1] - p[at + 1]);
    const Z = p[at + 2] + f * (q[at + 2] - p[at + 2]);
    const depth = c0 * X + c1 * Y + c2 * Z + c3;
    if (depth < header.near) continue;
    const u = (a0 * X + a1 * Y + a2 * Z + a3) / depth, v = (b0 * X + b1 * Y + b2 * Z + b3) / depth;

    const turnA = before.shape[2 * i], turnB = after.shape[2 * i];
    const sizeA = before.shape[2 * i + 1], sizeB = after.shape[2 * i + 1];
    const byte = (shift) => {
      const from = (turnA << shift) >> 24;
      return from + f * (((turnB << shift) >> 24) - from);
    };
    const size = (shift) => {
      const from = (sizeA >>> shift) & 1023;
      return Math.exp((from + f * (((sizeB >>> shift) & 1023) - from) - 512) * step);
    };
    let w = byte(24), x = byte(16), y = byte(8), z = byte(0);
    const unit = 1 / Math.max(Math.sqrt(w * w + x * x + y * y + z * z), 1e-12);
    w *= unit, x *= unit, y *= unit, z *= unit;
    const s0 = size(0), s1 = size(10), s2 = size(20);

    // The covariance's square root on the screen: rows of Jacobian, view and rotation, scaled.
    const heldU = Math.min(Math.max(u, left), right), heldV = Math.min(Math.max(v, top), bottom);
    const k = fx / depth, l = fy / depth;
    const j0 = k * (a0 - heldU * c0), j1 = k * (a1 - heldU * c1), j2 = k * (a2 - heldU * c2);
    const h0 = l * (b0 - heldV * c0), h1 = l * (b1 - heldV * c1), h2 = l * (b2 - heldV * c2);
    const r00 = 1 - 2 * (y * y + z * z), r01 = 2 * (x * y - w * z), r02 = 2 * (x * z + w * y);
    const r10 = 2 * (x * y + w * z), r11 = 1 - 2 * (x * x + z * z), r12 = 2 * (y * z - w * x);
    const r20 = 2 * (x * z - w * y), r21 = 2 * (y * z + w * x), r22 = 1 - 2 * (x * x + y * y);
    const m0 = (j0 * r00 + j1 * r10 + j2 * r20) * s0, m1 = (j0 * r01 + j1 * r11 + j2 * r21) * s1;
    const m2 = (j0 * r02 + j1 * r12 + j2 * r22) * s2;
    const n0 = (h0 * r00 + h1 * r10 + h2 * r20) * s0, n1 = (h0 * r01 + h1 * r11 + h2 * r21) * s1;
    const n2 = (h0 * r02 + h1 * r12 + h2 * r22) * s2;
    const a = m0 * m0 + m1 * m1 + m2 * m2 + low, b = m0 * n0 + m1 * n1 + m2 * n2;
    const c = n0 * n0 + n1 * n1 + n2 * n2 + low;

    const px = fx * u + cx, py = fy * v + cy, reach = 2 * Math.log(opacity / faintest);
    const reachX = Math.sqrt(reach * a), reachY = Math.sqrt(reach * c);
    if (px + reachX < 0 || px - reachX > width || py + reachY < 0 || py - reachY > height) continue;
    const colorA = before.place[at + 3], colorB = after.place[at + 3];
    const channel = (shift) => {
      const from = (colorA >>> shift) & 255;
      return (from + f * (((colorB >>> shift) & 255) - from)) / 255;
    };
    const o = count * FIELDS;
    splats[o] = px, splats[o + 1] = py;
    splats[o + 2] = b / c, splats[o + 3] = c / (a * c - b * b), splats[o + 4] = 1 / c; // completed to squares
    splats[o + 5] = reach, splats[o + 6] = reachY, splats[o + 7] = opacity;
    splats[o + 8] = channel(0), splats[o + 9] = channel(8), splats[o + 10] = channel(16);
    depths[count++] = depth;
  }
  return { splats, depths, count };
}

// exp(-x) for x in [0, FARTHEST], from a table: exact to 3e-7 of itself.
const FARTHEST = 16, CELLS = 8192;
const FALLS = Float64Array.from({ length: CELLS + 2 }, (_, i) => Math.exp((-i * FARTHEST) / CELLS));
function fall(x) {
  const place = x * (CELLS / FARTHEST), cell = place | 0;
  return FALLS[cell] + (place - cell) * (FALLS[cell + 1] - FALLS[cell]);
}

// Rows first, first + stride, ... of a picture, far splats first: {rows of RGBA bytes, one after the other}.
function picture(scene, job) {
  const { width, height } = job.lens, { first, stride } = job;
  const { splats, depths, count } = project(scene, job.t, job.matrix, job.lens);
  const most = scene.header.constants.max_alpha;
  const rows = Math.max(Math.ceil((height - first) / stride), 0);
  const image = new Float32Array(rows * width * 3);
  for (let i = 0; i < image.length; i++) image[i] = scene.header.background[i % 3];
  for (const rank of farToNear(depths, count)) {
    const at = rank * FIELDS;
    const px = splats[at], py = splats[at + 1], lean = splats[at + 2], along = splats[at + 3], down = splats[at + 4];
    const reach = splats[at + 5], reachY = splats[at + 6], opacity = splats[at + 7];
    const red = splats[at + 8], green = splats[at + 9], blue = splats[at + 10];
    // Along a row the exponent is quadratic: from one pixel to the next alpha changes by a ratio, and that by `decay`.
    const decay = Math.exp(-along), root = Math.exp(-along / 2);
    const highest = Math.max(Math.ceil(py - reachY - 0.5), 0), lowest = Math.min(Math.floor(py + reachY - 0.5), height - 1);
    for (let y = highest + ((((first - highest) % stride) + stride) % stride); y <= lowest; y += stride) {
      const dy = y + 0.5 - py, row = dy * dy * down;
      if (row > reach) continue;
      const half = Math.sqrt((reach - row) / along), middle = px + lean * dy;
      const start = Math.max(Math.ceil(middle - half - 0.5), 0), end = Math.min(Math.floor(middle + half - 0.5), width - 1);
      if (start > end) continue;
      const dx = start + 0.5 - middle, bend = along * dx;
      let alpha = opacity * fall((bend * dx + row) / 2);
      let ratio = bend > 0 ? root * fall(Math.min(bend, FARTHEST)) : root / fall(Math.min(-bend, FARTHEST));
      const line = ((y - first) / stride) * width;
      for (let pixel = 3 * (line + start), stop = 3 * (line + end); pixel <= stop; pixel += 3) {
        const weight = alpha < most ? alpha : most;
        image[pixel] += weight * (red - image[pixel]);
        image[pixel + 1] += weight * (green - image[pixel + 1]);
        image[pixel + 2] += weight * (blue - image[pixel + 2]);
        alpha *= ratio;
        ratio *= decay;
      }
    }
  }
  const bytes = new Uint8ClampedArray(rows * width * 4);
  for (let i = 0, j = 0; i < image.length; i += 3, j += 4) {
    bytes[j] = image[i] * 255;
    bytes[j + 1] = image[i + 1] * 255;
    bytes[j + 2] = image[i + 2] * 255;
    bytes[j + 3] = 255;
  }
  return bytes;
}
