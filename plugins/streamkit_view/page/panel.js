// Text of the page: figures, list of tracks, feeds. What comes from the network is only ever set as text.

export const byId = (id) => document.getElementById(id);

export function element(name, text, attributes = {}) {
  const made = document.createElement(name);
  if (text !== null) made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

export function showState(state, reason) {
  const pill = byId("state");
  if (pill.textContent !== state) pill.textContent = state;
  pill.className = `state ${state}`;
  const fault = byId("fault");
  const text = ["lost", "silent", "offline"].includes(state) ? reason : "";
  if (fault.textContent !== text) fault.textContent = text;
  fault.hidden = text === "";
}

export function showNote(text) {
  if (byId("note").textContent !== text) byId("note").textContent = text;
}

export function showFigures(figures) {
  const list = byId("figures");
  while (list.children.length > 2 * figures.length) list.lastChild.remove();
  figures.forEach(([name, value], index) => {
    if (list.children.length <= 2 * index) list.append(element("dt", ""), element("dd", ""));
    const [term, detail] = [list.children[2 * index], list.children[2 * index + 1]];
    if (term.textContent !== name) term.textContent = name;
    if (detail.textContent !== value) detail.textContent = value;
  });
}

export function showFeeds(states, selected, select) {
  const nav = byId("feeds");
  if (states.length < 2) {
    nav.textContent = states[0]?.key ?? "";
    return;
  }
  while (nav.children.length > states.length) nav.lastChild.remove();
  states.forEach((state, index) => {
    if (!nav.children[index]) {
      const button = element("button", "", { type: "button" });
      button.addEventListener("click", () => select(index));
      nav.append(button);
    }
    const button = nav.children[index];
    const text = state.state === "playing" ? state.key : `${state.key} (${state.state})`;
    if (button.textContent !== text) button.textContent = text;
    button.setAttribute("aria-pressed", String(index === selected));
  });
}

// Rows are kept, so that the keyboard's focus stays where it is.
// `metres(track)` is its speed in m/s, or null.
export function showTracks(tracks, followed, follow, metres) {
  const rows = byId("rows");
  const shown = tracks.filter((track) => track.state !== "lost" && track.state !== "tentative");
  byId("count").textContent = String(shown.length);
  const isLocated = shown.some((track) => track.geo);
  rows.closest("table").classList.toggle("located", isLocated);
  const kept = new Map([...rows.children].map((row) => [row.dataset.id, row]));
  for (const track of shown) {
    const id = String(track.id);
    const row = kept.get(id) ?? trackRow(id, follow);
    kept.delete(id);
    if (!row.isConnected) rows.append(row);
    row.className = track.state;
    const isFollowed = track.id === followed;
    row.querySelector("button").setAttribute("aria-pressed", String(isFollowed));
    const speed = speedText(track, metres(track));
    const texts = [track.state, speed, `${(track.age_ns / 1e9).toFixed(0)} s`, place(track.geo)];
    texts.forEach((text, index) => {
      const cell = row.children[index + 1];
      if (cell.textContent !== text) cell.textContent = text;
    });
  }
  for (const row of kept.values()) row.remove();
}

function speedText(track, metres) {
  if (track.vx === undefined) return "unknown";
  return metres === null ? `${Math.hypot(track.vx, track.vy).toFixed(0)} px/s` : `${metres.toFixed(1)} m/s`;
}

function trackRow(id, follow) {
  const row = element("tr", null);
  row.dataset.id = id;
  const button = element("button", id, { type: "button", "aria-label": `Follow track ${id}`, "aria-pressed": "false" });
  button.addEventListener("click", () => follow(Number(id)));
  const head = element("td", null);
  head.append(button);
  row.append(head, ...["", "", "", ""].map((text) => element("td", text)));
  row.lastChild.className = "position";
  return row;
}

export const place = (geo) => (geo ? `${geo.lat.toFixed(5)}, ${geo.lon.toFixed(5)}` : "");
