// The picture without a graphics processor: workers share out its rows.

const MOST_WORKERS = 4;
const MOST_PIXELS = 1280 * 720; // of a picture at rest; larger ones are enlarged

class CpuPainter {
  constructor(canvas, scene) {
    Object.assign(this, { canvas, name: "the processor", most: MOST_PIXELS, onnews: null });
    this.context = canvas.getContext("2d", { alpha: false });
    const count = Math.min(Math.max(navigator.hardwareConcurrency || 1, 1), MOST_WORKERS);
    this.workers = Array.from({ length: count }, (_, first) => {
      const worker = startWorker(scene, ["place", "shape"]);
      worker.onmessage = ({ data }) => this.#came(first, data.result);
      return worker;
    });
    this.jobs = []; // views that are being drawn, the oldest first, and the rows of each that have come
    this.shown = null; // the view that is on the canvas
  }

  // One view is drawn and one waits, so that no worker does: beyond that the caller draws again at `onnews`.
  draw(view) {
    const newest = this.jobs.at(-1)?.view ?? this.shown;
    if (newest === view || this.jobs.length > 1) return;
    this.jobs.push({ view, rows: [] });
    const stride = this.workers.length;
    this.workers.forEach((worker, first) =>
      worker.postMessage({ what: "picture", t: view.t, matrix: view.matrix, lens: view.lens, first, stride }));
  }

  // A worker answers in the order of its jobs.
  #came(first, bytes) {
    this.jobs.find(({ rows }) => !rows[first]).rows[first] = bytes;
    const [{ view, rows }] = this.jobs;
    if (rows.filter(Boolean).length < this.workers.length) return;
    this.jobs.shift();
    const { width, height } = view.lens, stride = this.workers.length;
    const image = new ImageData(width, height), line = 4 * width;
    for (let y = 0; y < height; y++) {
      const from = Math.floor(y / stride) * line;
      image.data.set(rows[y % stride].subarray(from, from + line), y * line);
    }
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
    this.context.putImageData(image, 0, 0);
    this.shown = view;
    this.onnews?.();
  }
}
