// The page: time, camera and what a person does to them.

const SPEEDS = [0.25, 0.5, 1, 2];
const IDLE_MS = 2500; // after which the bar hides while the scene plays
const REST_MS = 150; // after which a picture is drawn in full
const RETURN_MS = 700; // of the way back to the drone
const SLOW_MS = 36, QUICK_MS = 20; // between two pictures: the resolution falls, or rises again
const COARSEST = 0.35; // of the full resolution

const element = (id) => document.getElementById(id);

class Player {
  constructor(scene, options) {
    this.scene = scene;
    const { header } = scene;
    this.canvas = element("picture");
    this.painter = (options.painter !== "cpu" && GpuPainter.make(this.canvas, scene, options.painter === "gpu"))
      || new CpuPainter(this.canvas, scene);
    this.painter.onnews = () => this.#presented();
    this.painter.onlost = () => say("The graphics driver has stopped. Reload the page to go on.");
    this.views = header.views.map(poseOfView);
    this.length = header.seconds.at(-1);
    this.seconds = 0;
    this.speed = 1;
    this.playing = false;
    this.flying = true;
    this.pose = this.views[0];
    this.returning = null;
    this.scale = 1;
    this.pace = null;
    this.moved = -Infinity;
    this.view = null;
    this.pictures = 0; // shown since the page was opened
    this.shownAt = 0;
    this.moves = false;
    this.waiting = [];
    this.target = this.#ahead();
    new ResizeObserver(() => this.#touch()).observe(this.canvas);
    this.#interface();
    this.#wake();
  }

  // --- what a page around it, or a test, may call ---

  seek(seconds) {
    this.seconds = Math.min(Math.max(seconds, 0), this.length);
    this.#touch();
  }

  play(on = true) {
    if (on && this.seconds >= this.length) this.seconds = 0;
    this.playing = on && this.length > 0;
    this.last = null;
    element("play").setAttribute("aria-label", this.playing ? "Pause" : "Play");
    document.body.classList.toggle("playing", this.playing);
    this.#busy();
    this.#touch();
  }

  fly(on = true) {
    if (on && !this.flying) this.returning = { from: this.pose, at: performance.now() };
    if (!on && this.flying) this.target = this.#ahead();
    this.flying = on;
    element("fly").setAttribute("aria-pressed", String(on));
    this.#touch();
  }

  look(pose, target) {
    this.fly(false);
    this.pose = pose;
    this.target = target;
    this.#touch();
  }

  // Resolves when the picture is that of now, in full.
  settled() {
    return new Promise((resolve) => {
      this.waiting.push(resolve);
      this.#wake();
    });
  }

  // --- time ---

  #tick(now) {
    this.asked = false;
    if (this.playing) {
      if (this.last !== null) this.seconds += ((now - this.last) / 1000) * this.speed;
      this.last = now;
      if (this.seconds > this.length) this.seconds %= this.length || 1;
      this.moved = now;
    }
    this.#place(now);
    const resting = now - this.moved > REST_MS;
    this.#show(resting ? 1 : this.scale);
    if (this.painter.draw(this.view)) this.#count(now);
    this.#label();
    const done = resting && this.painter.shown === this.view;
    if (done) for (const resolve of this.waiting.splice(0)) resolve();
    if (!done) this.#wake();
    else this.pace = null;
  }

  #wake() {
    if (!this.asked) requestAnimationFrame((now) => this.#tick(now));
    this.asked = true;
  }

  #touch() {
    this.moved = performance.now();
    this.#wake();
  }

  #presented() {
    if (this.painter instanceof CpuPainter) this.#count(performance.now());
    this.#wake();
  }

  // How long pictures take decides on how many pixels they have while something moves.
  #count(now) {
    this.pictures++;
    const took = Math.min(now - this.shownAt, 500), moves = this.playing || now - this.moved <= REST_MS;
    const goesOn = moves && this.moves;
    this.shownAt = now;
    this.moves = moves; // the first picture after a rest says nothing of what pictures take
    if (!goesOn) return;
    this.pace = this.pace === null ? took : this.pace + 0.2 * (took - this.pace);
    if (this.pace > SLOW_MS) this.scale = Math.max(COARSEST, this.scale * 0.93);
    else if (this.pace < QUICK_MS) this.scale = Math.min(1, this.scale * 1.03);
  }

  // --- camera ---

  #place(now) {
    if (!this.flying) return;
    const [view, fraction] = bracket(this.scene.header.seconds, this.seconds);
    const drone = between(this.views[view], this.views[Math.min(view + 1, this.views.length - 1)], fraction);
    const share = this.returning ? (now - this.returning.at) / RETURN_MS : 1;
    if (share >= 1) this.returning = null;
    else this.moved = now;
    this.pose = share < 1 ? between(this.returning.from, drone, share * share * (3 - 2 * share)) : drone;
  }

  // The new view, or the one that is there where nothing has changed.
  #show(scale) {
    const { header } = this.scene, box = this.canvas.getBoundingClientRect();
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const pixels = Math.max(box.width * box.height * ratio * ratio, 1);
    const factor = ratio * scale * Math.min(1, Math.sqrt(this.painter.most / pixels));
    const width = Math.max(Math.round(box.width * factor), 1), height = Math.max(Math.round(box.height * factor), 1);
    const [key, fraction] = bracket(header.seconds, this.seconds);
    const t = header.t[key] + fraction * ((header.t[key + 1] ?? header.t[key]) - header.t[key]);
    const view = { t, matrix: matrixOf(this.pose), lens: lensFor(header.camera, width, height) };
    const name = JSON.stringify([t, view.matrix, width, height]);
    if (this.view?.name !== name) this.view = { ...view, name };
  }

  #lens() {
    const { width, height } = this.canvas.getBoundingClientRect();
    return lensFor(this.scene.header.camera, width, height);
  }

  #ahead() {
    const { width, height } = this.canvas.getBoundingClientRect();
    const { header } = this.scene, t = header.t[bracket(header.seconds, this.seconds)[0]];
    return pick(this.scene, t, this.pose, this.#lens(), width / 2, height / 2)
      ?? plus(this.pose.center, row(this.pose.turn, 2), header.distance);
  }

  #orbit(around, over) {
    this.fly(false);
    this.pose = orbited(this.pose, this.target, around, over);
    this.#touch();
  }

  #pan(right, down) {
    this.fly(false);
    const lens = this.#lens(), away = Math.hypot(...plus(this.target, this.pose.center, -1));
    const shift = plus(row(this.pose.turn, 0).map((v) => (-v * right * away) / lens.fx), row(this.pose.turn, 1), (-down * away) / lens.fy);
    this.pose = { ...this.pose, center: plus(this.pose.center, shift) };
    this.target = plus(this.target, shift);
    this.#touch();
  }

  #zoom(factor) {
    this.fly(false);
    const away = plus(this.pose.center, this.target, -1), distance = Math.hypot(...away);
    const wanted = Math.min(Math.max(distance * factor, 4 * this.scene.header.near), 50 * this.scene.header.distance);
    this.pose = { ...this.pose, center: plus(this.target, away, wanted / distance) };
    this.#touch();
  }

  #focus(x, y) {
    const box = this.canvas.getBoundingClientRect(), { header } = this.scene;
    const t = header.t[bracket(header.seconds, this.seconds)[0]];
    const found = pick(this.scene, t, this.pose, this.#lens(), x - box.left, y - box.top);
    if (!found) return;
    this.fly(false);
    this.target = found;
    const mark = element("mark");
    Object.assign(mark.style, { left: `${x}px`, top: `${y}px` });
    mark.getAnimations().forEach((animation) => animation.cancel());
    mark.animate([{ opacity: 1, scale: 1.6 }, { opacity: 0, scale: 0.6 }], { duration: 700 });
  }

  // --- interface ---

  #interface() {
    const { header } = this.scene;
    const slider = element("time");
    slider.max = this.length;
    slider.step = this.length / 1000 || 1;
    slider.addEventListener("input", () => {
      this.play(false);
      this.seek(Number(slider.value));
    });
    document.body.classList.toggle("still", this.length === 0);
    element("play").addEventListener("click", () => this.play(!this.playing));
    element("fly").addEventListener("click", () => this.fly(!this.flying));
    element("speed").addEventListener("click", () => this.#faster(1, true));
    element("full").addEventListener("click", () => this.#full());
    element("full").hidden = !document.fullscreenEnabled;
    element("help").addEventListener("click", () => element("about").showModal());
    element("about").addEventListener("click", (event) => event.target === element("about") && event.target.close());
    element("title").textContent = header.title;
    element("facts").textContent = `${header.count.toLocaleString("en")} Gaussians of the method ${header.method} at `
      + `${header.t.length} times; ${header.generator}; drawn by ${this.painter.name}.`
      + (header.origin ? ` Filmed around ${header.origin.latitude_deg.toFixed(5)}, ${header.origin.longitude_deg.toFixed(5)}.` : "");
    addEventListener("keydown", (event) => this.#key(event));
    // What a pointer has pressed neither keeps the bar in sight nor has a ring, as the focus of a keyboard does.
    addEventListener("pointerup", () => document.activeElement.blur());
    addEventListener("click", (event) => event.detail > 0 && document.activeElement.blur()); // a tap has its focus later
    element("about").addEventListener("close", () => {
      if (!document.activeElement.matches(":focus-visible")) document.activeElement.blur();
    });
    const touched = () => this.#busy();
    addEventListener("pointermove", touched);
    addEventListener("focusin", touched);
    document.addEventListener("visibilitychange", () => (this.last = null)); // time stands while nobody sees it
    listenTo(this.canvas, {
      orbit: (around, over) => this.#orbit(around, over),
      pan: (right, down) => this.#pan(right, down),
      zoom: (factor) => this.#zoom(factor),
      focus: (x, y) => this.#focus(x, y),
      touched,
    });
  }

  #label() {
    const slider = element("time");
    if (document.activeElement !== slider || this.playing) slider.value = this.seconds;
    slider.style.setProperty("--done", `${this.length ? (100 * this.seconds) / this.length : 0}%`);
    const digits = this.length < 100 ? 1 : 0;
    const text = `${this.seconds.toFixed(digits)} / ${this.length.toFixed(digits)} s`;
    if (element("clock").textContent !== text) element("clock").textContent = text;
  }

  #busy() {
    document.body.classList.remove("idle");
    clearTimeout(this.idle);
    this.idle = setTimeout(() => document.body.classList.toggle("idle", this.playing), IDLE_MS);
  }

  #faster(by, around = false) {
    const place = SPEEDS.indexOf(this.speed) + by;
    this.speed = SPEEDS[around ? place % SPEEDS.length : Math.min(Math.max(place, 0), SPEEDS.length - 1)];
    element("speed").textContent = `${this.speed}×`;
    element("speed").setAttribute("aria-label", `Speed ${this.speed}×`);
  }

  #step(frames) {
    this.play(false);
    const { seconds } = this.scene.header, [key, fraction] = bracket(seconds, this.seconds);
    const now = key + fraction, next = frames > 0 ? Math.floor(now + 1e-6) + frames : Math.ceil(now - 1e-6) + frames;
    this.seek(seconds[Math.min(Math.max(next, 0), seconds.length - 1)]);
  }

  #full() {
    if (document.fullscreenElement) document.exitFullscreen();
    else document.documentElement.requestFullscreen().catch(() => {});
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || element("about").open) return;
    const inButton = event.target instanceof HTMLButtonElement;
    const turn = 0.06;
    const actions = {
      " ": () => this.play(!this.playing),
      ArrowLeft: () => this.#step(-1),
      ArrowRight: () => this.#step(1),
      Home: () => this.seek(0),
      End: () => this.seek(this.length),
      "[": () => this.#faster(-1),
      "]": () => this.#faster(1),
      a: () => this.#orbit(-turn, 0),
      d: () => this.#orbit(turn, 0),
      w: () => this.#orbit(0, turn),
      s: () => this.#orbit(0, -turn),
      "+": () => this.#zoom(0.9),
      "=": () => this.#zoom(0.9),
      "-": () => this.#zoom(1 / 0.9),
      c: () => this.fly(!this.flying),
      f: () => this.#full(),
      h: () => element("about").showModal(),
      "?": () => element("about").showModal(),
    };
    const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (!actions[name] || (name === " " && inButton)) return;
    event.preventDefault();
    actions[name]();
    this.#busy();
  }
}

function say(text) {
  element("message").textContent = text;
  element("message").hidden = false;
}

element("loading").textContent = "Opening the scene …"; // by the script, so that it does not stand where none runs
window.player = (async () => {
  if (!("DecompressionStream" in window)) {
    throw say("This browser is too old to open the scene. Chrome 103, Firefox 113, Safari 16.4 or later can.");
  }
  const scene = await openScene(element("scene").textContent);
  const options = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  const player = new Player(scene, options);
  await player.settled();
  document.body.classList.add("ready");
  if (!matchMedia("(prefers-reduced-motion: reduce)").matches && options.play !== "off") player.play();
  return player;
})();
window.player.catch((error) => {
  if (error) say("This scene could not be opened: the file is damaged, or the browser has refused it memory.");
  if (error) console.error(error);
});
