// The ground in coordinates of the reference plane: the mosaic, the camera's footprint, tracks with their trails, a
// scale bar and the cursor's coordinates. Drag to pan, wheel or + and - to zoom, 0 or double click to fit.

import { nearest, project } from "./geometry.js";
import { fitCanvas, outline } from "./overlay.js";
import { byId } from "./panel.js";

const ZOOM = 1.25;
const MARGIN = 0.94;
const PAN_PX = 60;
const CLICK_PX = 18;
const BAR_PX = 140;

export class GroundMap {
  // `chosen(id)` is called when a track is clicked, `changed()` when the map must be drawn.
  constructor(canvas, section, { geo, mosaic, chosen, changed }) {
    Object.assign(this, { canvas, section, geo, mosaic, chosen, changed, pointers: new Map(), dots: [] });
    this.clear();
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => this.release(event));
    canvas.addEventListener("dblclick", () => this.fit());
    canvas.addEventListener("keydown", (event) => this.key(event));
    byId("fit").addEventListener("click", () => this.fit());
    new IntersectionObserver((changes) => {
      this.isVisible = changes.at(-1).isIntersecting;
      this.changed();
    }).observe(canvas);
  }

  clear() {
    this.view = null;
    this.isFitted = true;
    this.reference = undefined;
    this.section.hidden = true;
  }

  fit() {
    this.isFitted = true;
    this.changed();
  }

  draw(record, trails, followed) {
    const registration = record?.registration;
    if (!registration?.to_reference) return;
    this.section.hidden = false;
    if (!this.isVisible) return;
    const ratio = fitCanvas(this.canvas);
    const context = this.canvas.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    const footprint = rectangle(record.width, record.height, registration.to_reference);
    const mosaic = this.mosaic.corners(record);
    if (footprint.length + mosaic.length === 0) return;
    if (this.reference !== registration.reference) this.isFitted = true;
    this.reference = registration.reference;
    if (this.isFitted) this.view = fitted([...footprint, ...mosaic], this.canvas);
    if (mosaic.length) this.drawMosaic(context, mosaic.map((corner) => this.at(corner)));
    if (footprint.length) outline(context, footprint.map((point) => this.at(point)), "#32d7ff", 1.5 * ratio);
    this.drawTracks(context, record, trails, followed, ratio);
    this.drawBar(context, ratio);
  }

  // Screen pixels of a plane point, and back.
  at([x, y]) {
    const { scale, left, top } = this.view;
    return [x * scale + left, y * scale + top];
  }

  back([x, y]) {
    const { scale, left, top } = this.view;
    return [(x - left) / scale, (y - top) / scale];
  }

  // A canvas draws affine maps only: that of three corners, which for a preview is the exact one.
  drawMosaic(context, [origin, right, , below]) {
    const { canvas } = this.mosaic.shown;
    const across = [0, 1].map((axis) => (right[axis] - origin[axis]) / canvas.width);
    const down = [0, 1].map((axis) => (below[axis] - origin[axis]) / canvas.height);
    context.setTransform(...across, ...down, ...origin);
    context.drawImage(canvas, 0, 0);
    context.setTransform(1, 0, 0, 1, 0, 0);
  }

  drawTracks(context, record, trails, followed, ratio) {
    this.dots = [];
    for (const track of record.tracks) {
      const onPlane = project(record.registration.to_reference, [track.x, track.y]);
      if (track.state === "lost" || track.state === "tentative" || !onPlane) continue;
      const isFollowed = track.id === followed;
      const [x, y] = this.at(onPlane);
      this.dots.push({ id: track.id, x: x / ratio, y: y / ratio });
      context.strokeStyle = context.fillStyle = isFollowed ? "#32d7ff" : "#ffd60a";
      context.lineWidth = (isFollowed ? 2.5 : 1.5) * ratio;
      context.beginPath();
      for (const point of trails.onPlane(track.id)) context.lineTo(...this.at(point));
      context.stroke();
      context.beginPath();
      context.arc(x, y, (isFollowed ? 6 : 4) * ratio, 0, 2 * Math.PI);
      context.fill();
    }
  }

  // A round length of at most BAR_PX: in metres where the ground's coordinates are known.
  drawBar(context, ratio) {
    const metres = this.geo.length([1, 0]);
    const unit = ((metres ?? 1) * ratio) / this.view.scale; // length of a CSS pixel
    const most = BAR_PX * unit;
    const power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].map((step) => step * power).find((step) => step <= most);
    const [x, y, width] = [12 * ratio, this.canvas.height - 14 * ratio, (length / unit) * ratio];
    context.fillStyle = "rgba(0, 0, 0, 0.6)";
    context.fillRect(x - 6 * ratio, y - 20 * ratio, Math.max(width, 60 * ratio) + 12 * ratio, 28 * ratio);
    context.fillStyle = "#ffffff";
    context.fillRect(x, y, width, 3 * ratio);
    context.font = `${12 * ratio}px system-ui, sans-serif`;
    context.fillText(`${length} ${metres === null ? "px of the plane" : "m"}`, x, y - 5 * ratio);
  }

  wheel(event) {
    event.preventDefault();
    this.zoom(event.deltaY < 0 ? ZOOM : 1 / ZOOM, this.place(event));
  }

  zoom(factor, [x, y] = [this.canvas.width / 2, this.canvas.height / 2]) {
    if (!this.view) return;
    const { scale, left, top } = this.view;
    this.view = { scale: scale * factor, left: x - (x - left) * factor, top: y - (y - top) * factor };
    this.isFitted = false;
    this.changed();
  }

  pan(x, y) {
    if (!this.view) return;
    this.view = { ...this.view, left: this.view.left + x, top: this.view.top + y };
    this.isFitted = false;
    this.changed();
  }

  key(event) {
    const ratio = window.devicePixelRatio || 1;
    const steps = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const step = steps[event.key];
    if (step) this.pan(step[0] * PAN_PX * ratio, step[1] * PAN_PX * ratio);
    else if (event.key === "+") this.zoom(ZOOM);
    else if (event.key === "-") this.zoom(1 / ZOOM);
    else if (event.key === "0") this.fit();
    else return;
    event.preventDefault();
  }

  // Pixels of the canvas.
  place(event) {
    const box = this.canvas.getBoundingClientRect();
    const ratio = this.canvas.width / box.width;
    return [(event.clientX - box.left) * ratio, (event.clientY - box.top) * ratio];
  }

  press(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, this.place(event));
    this.travelled = 0;
  }

  move(event) {
    const to = this.place(event);
    this.describe(to);
    const from = this.pointers.get(event.pointerId);
    if (!from) return;
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    this.pointers.set(event.pointerId, to);
    this.travelled += Math.hypot(to[0] - from[0], to[1] - from[1]);
    if (other) this.zoom(apart(other, to) / Math.max(apart(other, from), 1), other);
    else if (this.travelled > 3) this.pan(to[0] - from[0], to[1] - from[1]);
  }

  release(event) {
    const was = this.pointers.delete(event.pointerId);
    if (!was || this.travelled > 3 || event.type !== "pointerup") return;
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    const dot = nearest(this.dots, (one) => Math.hypot(one.x - x, one.y - y), CLICK_PX);
    if (dot) this.chosen(dot.id);
  }

  describe(place) {
    if (!this.view) return;
    const point = this.back(place);
    const found = this.geo.locate(point);
    const onGround = found && `${found.lat.toFixed(6)}, ${found.lon.toFixed(6)} ± ${found.error.toFixed(1)} m`;
    byId("cursor").textContent = `${onGround ? `${onGround}, ` : ""}plane ${point[0].toFixed(0)}, ${point[1].toFixed(0)} px`;
  }
}

const apart = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

function rectangle(width, height, toPlane) {
  const corners = [[0, 0], [width, 0], [width, height], [0, height]].map((point) => project(toPlane, point));
  return corners.every((point) => point !== null && point.every(Number.isFinite)) ? corners : [];
}

function fitted(points, canvas) {
  const [low, high] = [Math.min, Math.max].map((pick) => [0, 1].map((axis) => pick(...points.map((p) => p[axis]))));
  const scale = MARGIN * Math.min(canvas.width / (high[0] - low[0]), canvas.height / (high[1] - low[1]));
  return {
    scale,
    left: (canvas.width - scale * (low[0] + high[0])) / 2,
    top: (canvas.height - scale * (low[1] + high[1])) / 2,
  };
}
