// The track that is followed: where its row comes from, in words, and its crop over time.

import { byId } from "./panel.js";

const CROPS = 8;
const CROP_PX = 72;
const EVERY_MS = 1000;
const SIDES = 3; // of the crop, over the target's longer one

export class Followed {
  constructor() {
    this.canvas = byId("crops");
    this.clear();
  }

  clear() {
    this.id = null;
    this.cropped = -Infinity;
    this.canvas.width = CROPS * CROP_PX;
    this.canvas.height = CROP_PX;
    byId("followed").hidden = true;
  }

  // Called with each frame on the screen and its own record.
  // `width` is that of the picture.
  show(picture, width, record, id, place) {
    const track = record?.tracks.find((other) => other.id === id);
    if (id !== this.id) {
      this.clear();
      this.id = id;
    }
    if (id === null) return;
    byId("followed").hidden = false;
    const text = track ? sentences(track, place).join(" ") : `Track ${id} is not in this frame.`;
    if (byId("explain").textContent !== text) byId("explain").textContent = text;
    if (track && performance.now() - this.cropped >= EVERY_MS) this.crop(picture, track, width / record.width);
  }

  // The newest crop stands on the right.
  crop(picture, { x, y, length, width }, shrink) {
    this.cropped = performance.now();
    const context = this.canvas.getContext("2d");
    context.drawImage(this.canvas, -CROP_PX, 0);
    const side = SIDES * Math.max(length, width) * shrink;
    const left = (CROPS - 1) * CROP_PX;
    context.clearRect(left, 0, CROP_PX, CROP_PX);
    context.drawImage(picture, x * shrink - side / 2, y * shrink - side / 2, side, side, left, 0, CROP_PX - 2, CROP_PX);
  }
}

// As `streamkit explain` says it, of one row; without provenance only what the row itself has.
function sentences(track, place) {
  const { provenance } = track;
  const found = [`Track ${track.id} is ${track.state}, ${(track.age_ns / 1e9).toFixed(1)} s old,`
    + ` score ${track.score.toFixed(2)}${place ? `, at ${place}` : ""}.`];
  if (!provenance) return found;
  if (provenance.cause) found.push(`${provenance.cause[0].toUpperCase()}${provenance.cause.slice(1)}.`);
  const { predicted, detection } = provenance;
  if (predicted) {
    const apart = Math.hypot(track.x - predicted[0], track.y - predicted[1]);
    found.push(`It is ${apart.toFixed(1)} px from where it was predicted.`);
  }
  if (detection) {
    const gate = detection.gate === undefined ? "" : `, ${detection.gate.toFixed(1)} standard deviations from the prediction`;
    found.push(`Detection ${detection.row} belongs to it${gate}${detection.label ? `, labelled ${detection.label}` : ""}.`);
  } else found.push(provenance.shared ? "It shares a detection with another target." : "No detection belongs to it.");
  if (provenance.similarity !== undefined) {
    found.push(`The best window resembles its template by ${provenance.similarity.toFixed(2)},`
      + ` which ${provenance.learnt ? "was" : "was not"} learnt.`);
  }
  return found;
}
