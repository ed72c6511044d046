// Hands on the picture: one finger or button orbits, two fingers or the other button pan, wheel and pinch zoom.

const TURN_PER_PX = 0.005; // radians
const TAP_PX = 6;
const TAP_MS = 350;

// `on` has orbit(around, over), pan(right, down), zoom(factor), focus(x, y) and touched().
function listenTo(canvas, on) {
  const pointers = new Map();
  let down = null, lastTap = 0;

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    down = pointers.size === 1 ? { x: event.clientX, y: event.clientY, at: event.timeStamp } : null;
    on.touched();
  });
  canvas.addEventListener("pointermove", (event) => {
    const was = pointers.get(event.pointerId);
    if (!was) return on.touched();
    const [x, y] = [event.clientX, event.clientY], [dx, dy] = [x - was[0], y - was[1]];
    if (pointers.size === 1) {
      if (event.buttons & 6 || event.shiftKey || event.ctrlKey) on.pan(dx, dy);
      else on.orbit(-dx * TURN_PER_PX, dy * TURN_PER_PX);
    } else if (pointers.size === 2) {
      const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      const before = Math.hypot(was[0] - other[0], was[1] - other[1]), after = Math.hypot(x - other[0], y - other[1]);
      on.pan(dx / 2, dy / 2);
      if (before > 0 && after > 0) on.zoom(before / after);
    }
    pointers.set(event.pointerId, [x, y]);
  });
  const released = (event) => {
    pointers.delete(event.pointerId);
    const still = down && Math.hypot(event.clientX - down.x, event.clientY - down.y) < TAP_PX;
    if (!still || event.type !== "pointerup") return;
    if (event.timeStamp - lastTap < TAP_MS) on.focus(event.clientX, event.clientY);
    lastTap = event.timeStamp;
  };
  canvas.addEventListener("pointerup", released);
  canvas.addEventListener("pointercancel", released);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    on.zoom(Math.exp(Math.max(-1, Math.min(1, event.deltaY * lines * 0.0015))));
    on.touched();
  }, { passive: false });
}
