// Where the camera is: {turn, center}. `turn` holds the rows of the rotation from world to camera (x right, y down,
// z forward), 9 numbers; `center` is in meters, z up.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const plus = (a, b, k = 1) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
const mixed = (a, b, f) => a.map((value, i) => value + f * (b[i] - value));
const row = (turn, i) => turn.slice(3 * i, 3 * i + 3);
const applied = (turn, v) => [0, 1, 2].map((i) => dot(row(turn, i), v));

function poseOfView(viewmat) {
  const turn = viewmat.slice(0, 3).flatMap((r) => r.slice(0, 3));
  const shift = viewmat.slice(0, 3).map((r) => r[3]);
  const center = [0, 1, 2].map((i) => -(turn[i] * shift[0] + turn[3 + i] * shift[1] + turn[6 + i] * shift[2]));
  return { turn, center };
}

// World to camera, rows of 4: 12 numbers.
function matrixOf({ turn, center }) {
  return [0, 1, 2].flatMap((i) => [...row(turn, i), -dot(row(turn, i), center)]);
}

// Rodrigues: the matrix that turns by an angle about a unit axis, 9 numbers.
function turnAbout([x, y, z], angle) {
  const c = Math.cos(angle), s = Math.sin(angle), k = 1 - c;
  return [
    c + k * x * x, k * x * y - s * z, k * x * z + s * y,
    k * x * y + s * z, c + k * y * y, k * y * z - s * x,
    k * x * z - s * y, k * y * z + s * x, c + k * z * z,
  ];
}

// The camera carried about a point: around the vertical, and over it, but never past straight down or up.
function orbited(pose, target, around, over) {
  let result = carried(pose, target, turnAbout([0, 0, 1], around));
  const tilted = carried(result, target, turnAbout(row(result.turn, 0), over));
  const steep = Math.abs(row(tilted.turn, 2)[2]), was = Math.abs(row(result.turn, 2)[2]);
  return steep < 0.998 || steep < was ? tilted : result;
}

function carried({ turn, center }, target, by) {
  return {
    turn: [0, 1, 2].flatMap((i) => applied(by, row(turn, i))),
    center: plus(target, applied(by, plus(center, target, -1))),
  };
}

// A pose on the way from one to another: straight, and turning evenly enough over the small angles that occur.
function between(a, b, f) {
  const p = quaternion(a.turn), q = quaternion(b.turn);
  const sign = p.reduce((sum, value, i) => sum + value * q[i], 0) < 0 ? -1 : 1;
  const blended = p.map((value, i) => value + f * (sign * q[i] - value));
  const length = Math.hypot(...blended);
  const [w, x, y, z] = blended.map((value) => value / length);
  return {
    turn: [
      1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
      2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
      2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ],
    center: mixed(a.center, b.center, f),
  };
}

function quaternion(m) {
  const w = Math.sqrt(Math.max(0, 1 + m[0] + m[4] + m[8])) / 2, x = Math.sqrt(Math.max(0, 1 + m[0] - m[4] - m[8])) / 2;
  const y = Math.sqrt(Math.max(0, 1 - m[0] + m[4] - m[8])) / 2, z = Math.sqrt(Math.max(0, 1 - m[0] - m[4] + m[8])) / 2;
  // The largest is known to be safe; the signs of the others follow from it.
  const largest = Math.max(w, x, y, z);
  if (largest === w) return [w, (m[7] - m[5]) / (4 * w), (m[2] - m[6]) / (4 * w), (m[3] - m[1]) / (4 * w)];
  if (largest === x) return [(m[7] - m[5]) / (4 * x), x, (m[1] + m[3]) / (4 * x), (m[2] + m[6]) / (4 * x)];
  if (largest === y) return [(m[2] - m[6]) / (4 * y), (m[1] + m[3]) / (4 * y), y, (m[5] + m[7]) / (4 * y)];
  return [(m[3] - m[1]) / (4 * z), (m[2] + m[6]) / (4 * z), (m[5] + m[7]) / (4 * z), z];
}

// The capture's camera for a picture of another size: all of its frame is seen, but where the window is so narrow that
// most of it would be empty, only the middle of the frame.
function lensFor(camera, width, height) {
  const across = width / camera.width, down = height / camera.height;
  const scale = Math.max(Math.min(across, down), 0.6 * Math.max(across, down));
  const [[fx, , cx], [, fy, cy]] = camera.K;
  return {
    fx: fx * scale,
    fy: fy * scale,
    cx: width / 2 + (cx - camera.width / 2) * scale,
    cy: height / 2 + (cy - camera.height / 2) * scale,
    width,
    height,
    blur: Math.max(1, scale * scale), // the low-pass filter of the pixels that the scene was learned from
  };
}

// What stands behind a pixel, as a place in the world; null where nothing does. Nearest first, the light that is left
// falls; the place is where half of it is gone.
function pick(scene, t, pose, lens, x, y) {
  const { header, keys } = scene;
  const [before, fraction] = bracket(header.t, t);
  const key = keys[Math.min(fraction > 0.5 ? before + 1 : before, keys.length - 1)];
  const m = matrixOf(pose), near = [], reach = 0.02 * lens.height;
  for (let i = 0; i < header.count; i++) {
    const p = key.xyz.subarray(4 * i, 4 * i + 3);
    const depth = dot(m.slice(8, 11), p) + m[11];
    if (depth < header.near) continue;
    const u = (lens.fx * (dot(m.slice(0, 3), p) + m[3])) / depth + lens.cx - x;
    const v = (lens.fy * (dot(m.slice(4, 7), p) + m[7])) / depth + lens.cy - y;
    const away = (u * u + v * v) / (reach * reach);
    if (away < 1) near.push([depth, ((1 - away) * (key.place[4 * i + 3] >>> 24)) / 255]);
  }
  near.sort((a, b) => a[0] - b[0]);
  let light = 1, found = null;
  for (const [depth, alpha] of near) {
    light *= 1 - alpha;
    found = depth;
    if (light < 0.5) break;
  }
  if (found === null) return null;
  const ray = [(x - lens.cx) / lens.fx, (y - lens.cy) / lens.fy, 1];
  const inWorld = [0, 1, 2].map((i) => ray[0] * pose.turn[i] + ray[1] * pose.turn[3 + i] + pose.turn[6 + i]);
  return plus(pose.center, inWorld, found);
}
