// A scene: its header, and for each key the Gaussians as they are drawn. aa4d/export/html_page.py writes the layout.

async function openScene(base64) {
  const text = atob(base64.trim());
  const packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) packed[i] = text.charCodeAt(i);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const length = new DataView(bytes.buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
  return { header, keys: readKeys(header, bytes.subarray(4 + length)) };
}

// Where the channels of a level go. `place` holds x y z as floats (seen through `xyz`) and a word of red, green, blue and
// opacity in bytes; `shape` a word of w x y z in signed bytes, and one of three logarithms in ten bits.
const WRITERS = {
  position: (key, level, channel, step) => {
    for (let i = 0; i < level.length; i++) key.xyz[4 * i + channel] = level[i] * step;
  },
  color: (key, level, channel) => {
    for (let i = 0; i < level.length; i++) key.place[4 * i + 3] |= level[i] << (8 * channel);
  },
  opacity: (key, level) => {
    for (let i = 0; i < level.length; i++) key.place[4 * i + 3] |= level[i] << 24;
  },
  rotation: (key, level, channel) => {
    for (let i = 0; i < level.length; i++) key.shape[2 * i] |= (level[i] & 255) << (8 * channel);
  },
  log_scale: (key, level, channel) => {
    for (let i = 0; i < level.length; i++) key.shape[2 * i + 1] |= (level[i] + 512) << (10 * channel);
  },
};

function readKeys(header, bytes) {
  const n = header.count;
  const keys = header.t.map(() => {
    const place = new Uint32Array(4 * n);
    return { place, xyz: new Float32Array(place.buffer), shape: new Uint32Array(2 * n) };
  });
  let from = 0;
  const planes = (count, width) => Array.from({ length: width }, () => bytes.subarray(from, (from += count)));
  const number = (parts, i) => {
    let value = 0;
    for (let p = parts.length - 1; p >= 0; p--) value = (value << 8) | parts[p][i];
    return (value >>> 1) ^ -(value & 1); // 0 1 2 3 4 as 0 -1 1 -2 2
  };
  const level = new Int32Array(n);
  for (const [name, attribute] of Object.entries(header.attributes)) {
    for (let channel = 0; channel < attribute.channels; channel++) {
      const first = planes(n, attribute.first_bytes);
      const changes = planes((keys.length - 1) * n, attribute.change_bytes);
      for (let i = 0; i < n; i++) level[i] = number(first, i);
      keys.forEach((key, k) => {
        if (k > 0) for (let i = 0; i < n; i++) level[i] += number(changes, (k - 1) * n + i);
        WRITERS[name](key, level, channel, attribute.step);
      });
    }
  }
  return keys;
}

// The key before a time (or what else rises), and how far it is on the way to the next: [key, fraction].
function bracket(times, t) {
  const last = times.length - 1;
  if (last < 1 || t <= times[0]) return [0, 0];
  if (t >= times[last]) return [last - 1, 1];
  let key = 0;
  while (times[key + 1] <= t) key++;
  return [key, (t - times[key]) / (times[key + 1] - times[key])];
}
