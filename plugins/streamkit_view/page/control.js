// Control of the pipeline: its live properties as a form, and a box drawn on the video as a target.

import { byId, element } from "./panel.js";

export class Control {
  // `send(request)` sets a property, or with null asks for all.
  constructor({ send }) {
    this.send = send;
    this.mayControl = false;
    this.button = byId("draw");
    this.clear();
    this.button.addEventListener("click", () => this.toggle(!this.isDrawing));
  }

  clear() {
    this.run = null;
    this.inputs = new Map();
    this.window = null;
    byId("properties").replaceChildren();
    this.toggle(false);
    this.say("");
    this.button.hidden = true;
  }

  // Asks for the properties of a publisher that was not asked before.
  note(status) {
    byId("control").hidden = !status?.control;
    if (!status?.control || status.run === this.run) return;
    this.clear();
    this.run = status.run;
    if (this.mayControl) this.send(null);
    else this.say("To change properties, open the address that streamkit view printed at its start.");
  }

  toggle(isDrawing) {
    this.isDrawing = isDrawing;
    this.button.setAttribute("aria-pressed", String(isDrawing));
    byId("overlay").classList.toggle("drawing", isDrawing);
  }

  // A box, x y w h in pixels of the newest frame.
  draw(box) {
    this.toggle(false);
    this.send({ ...this.window, value: box.map((value) => value.toFixed(1)).join(",") });
  }

  say(text, isError = false) {
    byId("answer").textContent = text;
    byId("answer").classList.toggle("error", isError);
  }

  take({ request, reply }) {
    if (reply.error) {
      this.say(reply.error, true);
      this.inputs.get(`${request?.element} ${request?.property}`)?.reset();
      return;
    }
    for (const property of reply.properties ?? []) this.show(property);
    this.button.hidden = this.window === null;
    const set = request && reply.properties?.[0];
    if (set) this.say(`${set.element}: ${set.property} is ${set.value ?? "unset"}.`);
  }

  show(property) {
    const { element: owner, property: name } = property;
    if (property.factory === "particletrack" && name === "window") this.window = { element: owner, property: name };
    const key = `${owner} ${name}`;
    if (!this.inputs.has(key)) this.inputs.set(key, this.row(property));
    const row = this.inputs.get(key);
    row.value = property.value ?? "";
    row.reset();
  }

  row(property) {
    const { element: owner, property: name } = property;
    const input = inputFor(property);
    const read = () => (property.type === "bool" ? input.checked : input.value);
    const row = {
      value: null,
      reset: () => {
        if (property.type === "bool") input.checked = row.value === true;
        else input.value = String(row.value);
      },
    };
    input.addEventListener("change", () => this.send({ element: owner, property: name, value: read() }));
    const label = element("label", null, { title: property.doc ?? "" });
    const unit = property.unit ? ` (${property.unit})` : "";
    label.append(element("span", name + unit), input);
    group(owner).append(label);
    return row;
  }
}

function inputFor({ type, choices }) {
  if (type === "bool") return element("input", null, { type: "checkbox" });
  if (!choices?.length) return element("input", null, { type: "text", autocomplete: "off", spellcheck: "false" });
  const input = element("select", null);
  input.append(...choices.map((word) => element("option", word)));
  return input;
}

function group(owner) {
  const found = [...byId("properties").children].find((child) => child.dataset.element === owner);
  if (found) return found;
  const made = element("details", null);
  made.dataset.element = owner;
  made.append(element("summary", owner));
  byId("properties").append(made);
  return made;
}
