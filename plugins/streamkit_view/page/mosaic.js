// The mosaic of the ground: tiles come as they change, and are drawn into one canvas, which grows with them.

import { project } from "./geometry.js";

const BLACK = 8;

export class Mosaic {
  constructor() {
    this.clear();
  }

  clear() {
    this.shown = this.coming = null;
  }

  // Another mosaic, whose tiles follow; the one before is shown until all of the first `tiles` are here.
  begin({ reference, to_reference: toPlane, side, tiles }) {
    this.coming = new TiledImage(reference, toPlane, side, tiles);
  }

  // The mosaic to which the tiles that arrive now belong.
  get newest() {
    return this.coming ?? this.shown;
  }

  // Closes the image.
  take({ column, row }, image, tiled) {
    tiled?.take(column, row, image);
    image.close();
    if (this.coming?.isWhole) [this.shown, this.coming] = [this.coming, null];
  }

  // Where the corners of the canvas lie on the plane of a record, clockwise; [] if it shows another plane.
  corners(record) {
    const isOnPlane = this.shown && this.shown.reference === record?.registration?.reference;
    return isOnPlane ? this.shown.corners() : [];
  }
}

class TiledImage {
  constructor(reference, toPlane, side, tiles) {
    Object.assign(this, { reference, toPlane, side, tiles, taken: new Set(), version: 0 });
    this.canvas = null; // another one whenever it grows
    this.bounds = null; // of the canvas, left, top, right and bottom, pixels of the grid
  }

  get isWhole() {
    return this.taken.size >= this.tiles;
  }

  take(column, row, image) {
    const [x, y] = [column * this.side, row * this.side];
    this.makeRoom(x, y);
    this.canvas.getContext("2d").putImageData(transparent(image), x - this.bounds[0], y - this.bounds[1]);
    this.taken.add(`${column},${row}`);
    this.version += 1;
  }

  makeRoom(x, y) {
    const [left, top, right, bottom] = this.bounds ?? [x, y, x, y];
    const bounds = [Math.min(left, x), Math.min(top, y), Math.max(right, x + this.side), Math.max(bottom, y + this.side)];
    if (this.bounds?.every((bound, index) => bound === bounds[index])) return;
    const [canvas, before] = [document.createElement("canvas"), this.canvas];
    [canvas.width, canvas.height] = [bounds[2] - bounds[0], bounds[3] - bounds[1]];
    if (before) canvas.getContext("2d").drawImage(before, left - bounds[0], top - bounds[1]);
    [this.canvas, this.bounds] = [canvas, bounds];
  }

  corners() {
    const [left, top, right, bottom] = this.bounds.map((bound) => bound - 0.5);
    const points = [[left, top], [right, top], [right, bottom], [left, bottom]];
    const found = points.map((point) => project(this.toPlane, point));
    return found.every((point) => point?.every(Number.isFinite)) ? found : [];
  }
}

// A mosaic is black where there is none.
function transparent(image) {
  const context = new OffscreenCanvas(image.width, image.height).getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  const pixels = context.getImageData(0, 0, image.width, image.height);
  for (let at = 0; at < pixels.data.length; at += 4) {
    if (Math.max(pixels.data[at], pixels.data[at + 1], pixels.data[at + 2]) <= BLACK) pixels.data[at + 3] = 0;
  }
  return pixels;
}
