// The time line: how far back in time the page is, and how far it can go.

import { byId } from "./panel.js";

const LEAST_S = 5;

export class Timeline {
  // `go(seconds)` asks for the past; 0 is live.
  constructor({ go }) {
    this.slider = byId("back");
    this.slider.addEventListener("input", () => this.describe(-this.slider.value));
    this.slider.addEventListener("change", () => go(-this.slider.value));
    byId("live").addEventListener("click", () => go(0));
    this.clear();
  }

  clear() {
    this.show(0);
    byId("timeline").hidden = true;
  }

  // The server shows what came so many seconds ago.
  show(seconds) {
    this.seconds = seconds;
    this.slider.value = -seconds;
    byId("live").hidden = seconds === 0;
    this.describe(seconds);
  }

  limit(seconds) {
    byId("timeline").hidden = seconds < LEAST_S;
    this.slider.min = -Math.max(Math.floor(seconds), this.seconds);
  }

  describe(seconds) {
    const [minutes, rest] = [Math.floor(seconds / 60), String(seconds % 60).padStart(2, "0")];
    const text = seconds === 0 ? "live" : `${minutes}:${rest} ago`;
    byId("back-text").textContent = text;
    this.slider.setAttribute("aria-valuetext", text);
  }
}
