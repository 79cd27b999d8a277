// The mosaic as it grows, and on it the camera's footprint and the tracks, by the registration of both.

import { inverse, project } from "./geometry.js";
import { outline } from "./overlay.js";

export class Mosaic {
  constructor(canvas, section) {
    this.canvas = canvas;
    this.section = section;
    this.clear();
  }

  clear() {
    this.image?.close();
    this.image = null;
    this.motion = null;
    this.section.hidden = true;
  }

  show(image, header) {
    this.image?.close();
    this.image = image;
    this.motion = header.motion ?? null;
    this.section.hidden = false;
  }

  draw(record, trails, followed) {
    if (!this.image) return;
    const { canvas, image } = this;
    if (canvas.width !== image.width || canvas.height !== image.height) {
      [canvas.width, canvas.height] = [image.width, image.height];
    }
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    const registration = record?.registration;
    const fromPlane = this.motion?.to_reference ? inverse(this.motion.to_reference) : null;
    if (!fromPlane || !registration?.to_reference || registration.reference !== this.motion.reference) return;
    const place = (point) => {
      const onPlane = project(registration.to_reference, point);
      return onPlane && project(fromPlane, onPlane);
    };
    const thickness = Math.max(1, image.width / 500);
    const edge = [[0, 0], [record.width, 0], [record.width, record.height], [0, record.height]].map(place);
    if (edge.every((point) => point !== null)) outline(context, edge, "#32d7ff", thickness);
    for (const track of record.tracks) {
      const point = track.state === "lost" || track.state === "tentative" ? null : place([track.x, track.y]);
      if (point === null) continue;
      context.beginPath();
      context.arc(point[0], point[1], thickness * (track.id === followed ? 5 : 3), 0, 2 * Math.PI);
      context.fillStyle = track.id === followed ? "#32d7ff" : "#ffd60a";
      context.fill();
    }
  }
}
