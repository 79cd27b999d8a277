// The last two minutes, one sample a second: strips of age, frame rate, losses, work, targets and registration.

import { fitCanvas } from "./overlay.js";

const SAMPLES = 120;
const STRIP_PX = 40;
const TEXT_PX = 11;
const STRIPS = [
  { name: "age", unit: "ms", least: 50, value: (sample) => sample.age },
  { name: "frame rate", unit: "/s", least: 5, value: (sample) => sample.rate },
  { name: "dropped, lost, skipped", unit: "", least: 1, value: (sample) => sample.lost },
  { name: "busiest element", unit: "%", least: 100, value: ({ busiest }) => busiest && 100 * busiest.share },
  { name: "targets", unit: "", least: 5, value: (sample) => sample.targets },
];
const STATES = { ok: "--good", still: "--good", weak: "--warn", cut: "--bad", lost: "--bad" };

export class Series {
  constructor(canvas) {
    this.canvas = canvas;
    this.clear();
  }

  clear() {
    this.samples = [];
  }

  push(sample) {
    this.samples.push(sample);
    if (this.samples.length > SAMPLES) this.samples.shift();
    this.draw();
  }

  draw() {
    const ratio = fitCanvas(this.canvas);
    const context = this.canvas.getContext("2d");
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    context.font = `${TEXT_PX * ratio}px system-ui, sans-serif`;
    const step = this.canvas.width / (SAMPLES - 1);
    const at = (index) => (SAMPLES - this.samples.length + index) * step;
    STRIPS.forEach((strip, row) => this.drawStrip(context, strip, row * STRIP_PX * ratio, at, ratio, colour));
    const top = STRIPS.length * STRIP_PX * ratio;
    context.fillStyle = colour("--muted");
    context.fillText("registration; a line is a new epoch", 0, top + TEXT_PX * ratio);
    this.samples.forEach((sample, index) => {
      context.fillStyle = colour(STATES[sample.registration] ?? "--line");
      context.fillRect(at(index), top + 16 * ratio, step + 1, 6 * ratio);
      const before = this.samples[index - 1]?.epoch;
      if (before !== undefined && sample.epoch !== before) {
        context.fillStyle = colour("--ink");
        context.fillRect(at(index), 0, ratio, this.canvas.height);
      }
    });
  }

  drawStrip(context, { name, unit, least, value }, top, at, ratio, colour) {
    const values = this.samples.map(value);
    const known = values.filter((item) => item !== null);
    const most = Math.max(least, ...known);
    const last = values.at(-1);
    context.fillStyle = colour("--muted");
    const text = last === null || last === undefined ? "unknown" : `${last.toFixed(0)} ${unit}`;
    context.fillText(`${name}: ${text} (top ${most.toFixed(0)})`, 0, top + TEXT_PX * ratio);
    context.strokeStyle = colour("--accent");
    context.lineWidth = 1.5 * ratio;
    context.beginPath();
    const [bottom, height] = [top + (STRIP_PX - 4) * ratio, (STRIP_PX - 20) * ratio];
    let isDrawing = false;
    values.forEach((item, index) => {
      if (item !== null) context[isDrawing ? "lineTo" : "moveTo"](at(index), bottom - (item / most) * height);
      isDrawing = item !== null;
    });
    context.stroke();
  }
}
