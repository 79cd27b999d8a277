// The pointer on the video: a click chooses a track, a drag while drawing gives a box.

import { inverse, nearest, project } from "./geometry.js";
import { placement } from "./overlay.js";

const CLICK_PX = 24;
const SMALLEST_PX = 4;

export class Pointer {
  // `shown()` gives the size of the frame and the record on the screen.
  constructor(canvas, { shown, isDrawing, changed, chosen, drawn }) {
    Object.assign(this, { canvas, shown, isDrawing, changed, chosen, drawn, box: null });
    canvas.addEventListener("pointerdown", (event) => this.begin(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.end(event));
    canvas.addEventListener("pointercancel", () => this.cancel());
    canvas.addEventListener("click", (event) => this.click(event));
    window.addEventListener("keydown", (event) => event.key === "Escape" && this.cancel());
  }

  // Pixels of the frame.
  at(event) {
    const size = this.shown().size;
    const box = this.canvas.getBoundingClientRect();
    const ratio = this.canvas.width / box.width;
    const place = placement(this.canvas, size.width, size.height);
    const x = ((event.clientX - box.left) * ratio - place.left) / place.scale;
    const y = ((event.clientY - box.top) * ratio - place.top) / place.scale;
    return [x, y, CLICK_PX * ratio / place.scale];
  }

  begin(event) {
    if (!this.isDrawing() || !this.shown().size) return;
    const [x, y] = this.at(event);
    this.box = { from: [x, y], to: [x, y], record: this.shown().record };
    this.canvas.setPointerCapture(event.pointerId);
    this.changed();
  }

  move(event) {
    if (!this.box) return;
    this.box.to = this.at(event).slice(0, 2);
    this.changed();
  }

  end(event) {
    if (!this.box) return;
    this.move(event);
    const { from, to, record } = this.box;
    this.box = null;
    this.wasDrawing = true;
    const [left, top] = [0, 1].map((axis) => Math.min(from[axis], to[axis]));
    const [width, height] = [0, 1].map((axis) => Math.abs(from[axis] - to[axis]));
    if (Math.min(width, height) >= SMALLEST_PX) this.drawn([left, top, width, height], record);
    this.changed();
  }

  cancel() {
    this.box = null;
    this.changed();
  }

  click(event) {
    const { size, record } = this.shown();
    const wasDrawing = this.wasDrawing;
    this.wasDrawing = false;
    if (wasDrawing || this.isDrawing() || !size || !record) return;
    const [x, y, limit] = this.at(event);
    const drawn = record.tracks.filter(({ state }) => state !== "lost" && state !== "tentative");
    const track = nearest(drawn, (one) => Math.hypot(one.x - x, one.y - y) - one.length / 2, limit);
    if (track) this.chosen(track.id);
  }
}

// A box drawn on one frame, in pixels of a later one: it stays on the ground while the camera moves.
export function carried([left, top, width, height], from, to) {
  const [there, back] = [from?.registration, to?.registration];
  const fromPlane = there?.reference === back?.reference && back?.to_reference ? inverse(back.to_reference) : null;
  if (!there?.to_reference || !fromPlane) return [left, top, width, height];
  const moved = ([x, y]) => {
    const point = project(there.to_reference, [x, y]);
    return point && project(fromPlane, point);
  };
  const middle = moved([left + width / 2, top + height / 2]);
  const right = moved([left + width / 2 + 1, top + height / 2]);
  if (!middle || !right) return [left, top, width, height];
  const zoom = Math.hypot(right[0] - middle[0], right[1] - middle[1]);
  return [middle[0] - (zoom * width) / 2, middle[1] - (zoom * height) / 2, zoom * width, zoom * height];
}
