// The picture by the graphics processor, WebGL 2. A worker sorts; a picture is drawn at once with the order that is
// there, and again when the order has come.

const WIDE = 2048; // texels in a row of the textures that hold Gaussians
const QUADS = 4096; // in one instance: few instances for those who draw each by itself, and indices of 16 bits

function startWorker(scene, parts) {
  const address = URL.createObjectURL(new Blob([document.getElementById("worker").textContent]));
  const worker = new Worker(address);
  URL.revokeObjectURL(address);
  const keys = scene.keys.map((key) => Object.fromEntries(parts.map((part) => [part, key[part]])));
  worker.postMessage({ scene: { header: scene.header, keys } });
  return worker;
}

class GpuPainter {
  // Null where there is no WebGL 2, or only a slow one and `evenSlow` is false.
  static make(canvas, scene, evenSlow) {
    const wanted = { alpha: false, antialias: false, depth: false, powerPreference: "high-performance" };
    // The page's own canvas is asked last: one that has had a context gives no other.
    const probe = document.createElement("canvas").getContext("webgl2", { ...wanted, failIfMajorPerformanceCaveat: !evenSlow });
    if (!probe || (!evenSlow && drawnByProcessor(probe))) return null;
    const rows = Math.ceil(scene.header.count / WIDE);
    if (probe.getParameter(probe.MAX_TEXTURE_SIZE) < Math.max(WIDE, rows)) return null;
    const gl = canvas.getContext("webgl2", wanted);
    probe.getExtension("WEBGL_lose_context")?.loseContext();
    return gl && new GpuPainter(gl, scene, rows);
  }

  constructor(gl, scene, rows) {
    Object.assign(this, { gl, scene, rows, name: "WebGL 2", most: Infinity, onnews: null, onlost: null });
    this.program = program(gl, "vertex", "fragment");
    gl.useProgram(this.program);
    this.uniforms = new Proxy({}, { get: (known, name) => (known[name] ??= gl.getUniformLocation(this.program, name)) });
    this.textures = {};
    const formats = { uPlaceA: gl.RGBA32UI, uPlaceB: gl.RGBA32UI, uShapeA: gl.RG32UI, uShapeB: gl.RG32UI, uOrder: gl.R32UI };
    Object.entries(formats).forEach(([name, format], unit) => {
      const texture = gl.createTexture();
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, format, WIDE, rows);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      gl.uniform1i(this.uniforms[name], unit);
      this.textures[name] = { unit, key: -1 };
    });
    const corners = new Uint16Array(6 * QUADS);
    for (let i = 0; i < QUADS; i++) corners.set([0, 1, 2, 2, 1, 3].map((corner) => 4 * i + corner), 6 * i);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
    const { constants, near, attributes } = scene.header;
    gl.uniform1i(this.uniforms.uQuads, QUADS);
    gl.uniform1f(this.uniforms.uNear, near);
    gl.uniform1f(this.uniforms.uMargin, constants.margin);
    gl.uniform1f(this.uniforms.uFaintest, constants.faintest);
    gl.uniform1f(this.uniforms.uMaxAlpha, constants.max_alpha);
    gl.uniform1f(this.uniforms.uScaleStep, attributes.log_scale.step);
    gl.clearColor(...scene.header.background, 1);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.disable(gl.DITHER);
    gl.canvas.addEventListener("webglcontextlost", () => this.onlost?.());

    this.worker = startWorker(scene, ["place"]);
    this.worker.onmessage = ({ data }) => this.#ordered(data.result);
    this.ordered = null; // the view that the order is of
    this.sorting = null; // the view that it will be of
    this.shown = null; // the view that was drawn with its own order
    this.count = 0;
  }

  draw(view) {
    const { gl, uniforms } = this, { lens } = view, { header, keys } = this.scene;
    if (gl.isContextLost()) return;
    if (!this.sorting && this.ordered !== view) {
      this.sorting = view;
      this.worker.postMessage({ what: "order", t: view.t, matrix: view.matrix });
    }
    if (!this.ordered) return; // nothing is known to be there yet
    if (gl.canvas.width !== lens.width) gl.canvas.width = lens.width;
    if (gl.canvas.height !== lens.height) gl.canvas.height = lens.height;
    gl.viewport(0, 0, lens.width, lens.height);
    const [key, fraction] = bracket(header.t, view.t), next = Math.min(key + 1, keys.length - 1);
    this.#upload("uPlaceA", "uShapeA", key);
    this.#upload("uPlaceB", "uShapeB", next);
    const [a, b, c, d, e, f, g, h, i, j, k, l] = view.matrix;
    gl.uniformMatrix4fv(uniforms.uView, false, [a, e, i, 0, b, f, j, 0, c, g, k, 0, d, h, l, 1]);
    gl.uniform2f(uniforms.uFocal, lens.fx, lens.fy);
    gl.uniform2f(uniforms.uCenter, lens.cx, lens.cy);
    gl.uniform2f(uniforms.uSize, lens.width, lens.height);
    gl.uniform1f(uniforms.uDilation, header.constants.dilation * lens.blur);
    gl.uniform1f(uniforms.uFraction, fraction);
    gl.uniform1i(uniforms.uCount, this.count);
    gl.clear(gl.COLOR_BUFFER_BIT);
    const instances = Math.ceil(this.count / QUADS);
    if (instances) gl.drawElementsInstanced(gl.TRIANGLES, 6 * Math.min(this.count, QUADS), gl.UNSIGNED_SHORT, 0, instances);
    this.shown = this.ordered === view ? view : null;
    return true;
  }

  #ordered(order) {
    this.count = order.length;
    const padded = new Uint32Array(Math.max(Math.ceil(order.length / WIDE), 1) * WIDE);
    padded.set(order);
    this.#fill("uOrder", this.gl.RED_INTEGER, padded);
    this.ordered = this.sorting;
    this.sorting = null;
    this.onnews?.();
  }

  #upload(place, shape, key) {
    if (this.textures[place].key === key) return;
    this.textures[place].key = key;
    this.#fill(place, this.gl.RGBA_INTEGER, this.scene.keys[key].place);
    this.#fill(shape, this.gl.RG_INTEGER, this.scene.keys[key].shape);
  }

  // Whole rows at once, then what is left of the last.
  #fill(name, format, words) {
    const { gl } = this, wide = WIDE * { [gl.RED_INTEGER]: 1, [gl.RG_INTEGER]: 2, [gl.RGBA_INTEGER]: 4 }[format];
    gl.activeTexture(gl.TEXTURE0 + this.textures[name].unit);
    const rows = Math.floor(words.length / wide), left = words.subarray(rows * wide);
    if (rows) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, WIDE, rows, format, gl.UNSIGNED_INT, words);
    const texels = (left.length / wide) * WIDE;
    if (texels) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, rows, texels, 1, format, gl.UNSIGNED_INT, left);
  }
}

// Not every browser calls that slow, but they name the driver.
function drawnByProcessor(gl) {
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  return names !== null && /swiftshader|llvmpipe|softpipe|software|basic render/i.test(gl.getParameter(names.UNMASKED_RENDERER_WEBGL));
}

function program(gl, ...names) {
  const result = gl.createProgram();
  for (const name of names) {
    const shader = gl.createShader(name === "vertex" ? gl.VERTEX_SHADER : gl.FRAGMENT_SHADER);
    gl.shaderSource(shader, document.getElementById(name).textContent.trim());
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(result, shader);
  }
  gl.linkProgram(result);
  if (!gl.getProgramParameter(result, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(result));
  return result;
}
