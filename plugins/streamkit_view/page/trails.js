// Where each track was, on the reference plane, so that trails stay on the ground while the camera moves.

import { inverse, project } from "./geometry.js";

const EVERY_RECORDS = 3; // thin strokes are cheap to draw only with few points
const POINTS = 25;
const SILENT_RECORDS = 250;

export class Trails {
  constructor() {
    this.clear();
  }

  clear() {
    this.points = new Map();
    this.reference = undefined;
    this.epoch = undefined;
    this.count = 0;
  }

  note(record) {
    const registration = record.registration;
    if (registration?.reference !== this.reference || record.epoch !== this.epoch) this.clear();
    this.reference = registration?.reference;
    this.epoch = record.epoch;
    this.count += 1;
    const toPlane = registration?.to_reference;
    if (registration && !toPlane) return;
    for (const track of record.tracks) {
      const point = toPlane ? project(toPlane, [track.x, track.y]) : [track.x, track.y];
      if (point === null) continue;
      const trail = this.points.get(track.id) ?? { points: [], at: 0 };
      // The last point is the newest place; the others are three records apart.
      trail.points.splice(this.count % EVERY_RECORDS ? -1 : trail.points.length, 1, point);
      if (trail.points.length > POINTS) trail.points.shift();
      trail.at = this.count;
      this.points.set(track.id, trail);
    }
    for (const [id, trail] of this.points) if (this.count - trail.at > SILENT_RECORDS) this.points.delete(id);
  }

  // The trail of a track on the reference plane.
  onPlane(id) {
    return this.points.get(id)?.points ?? [];
  }

  // The trail of a track in pixels of the frame of a record.
  inFrame(record, id) {
    const points = this.onPlane(id);
    if (!record.registration) return points;
    const fromPlane = record.registration.to_reference ? inverse(record.registration.to_reference) : null;
    return fromPlane ? points.map((point) => project(fromPlane, point)).filter((point) => point !== null) : [];
  }
}
