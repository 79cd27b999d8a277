// The page: takes messages, keeps what is shown of one feed, and draws it once per screen refresh.

import { Connection, decompressed } from "./connection.js";
import { Control } from "./control.js";
import { EarthMap } from "./earth.js";
import { Followed } from "./followed.js";
import { GeoFit } from "./geo.js";
import { project } from "./geometry.js";
import { dropsOf, ElementLoad } from "./load.js";
import { GroundMap } from "./map.js";
import { Mosaic } from "./mosaic.js";
import { drawBox, drawTracks, fitCanvas } from "./overlay.js";
import { place, showFeeds, showFigures, showNote, showState, showTracks } from "./panel.js";
import { Player } from "./player.js";
import { carried, Pointer } from "./pointer.js";
import { Screen } from "./screen.js";
import { Series } from "./series.js";
import { Timeline } from "./timeline.js";
import { Trails } from "./trails.js";

const RECORDS_LIMIT = 400;
const STALE_NS = 250e6;
const ROUNDING_NS = 6e5; // half of Matroska's millisecond, and the ticks of other containers
const PLAUSIBLE_AGE_MS = 600_000;
const WAITING_LIMIT = 2; // frames: two that come within one refresh of the screen are shown by two refreshes

const screen = new Screen(document.getElementById("video"), document.getElementById("stream"));
const overlay = document.getElementById("overlay");
const geo = new GeoFit();
const series = new Series(document.getElementById("series"));
const load = new ElementLoad();
const followed = new Followed();
const mosaic = new Mosaic();
const map = new GroundMap(document.getElementById("map"), document.getElementById("ground"), {
  geo, mosaic, chosen: (id) => follow(id), changed: askDrawing,
});
const earth = new EarthMap(document.getElementById("earth-map"), document.getElementById("earth"), {
  geo, mosaic, chosen: (id) => follow(id),
});
const player = new Player({ show: showVideo, cannot: (reason) => { page.reason = reason; } });
const timeline = new Timeline({ go: (seconds) => connection.send({ back: seconds }) });
const control = new Control({ send: (request) => connection.send({ control: request }) });
const pointer = new Pointer(overlay, {
  shown: shownSize,
  isDrawing: () => control.isDrawing,
  changed: askDrawing,
  chosen: (id) => follow(id),
  drawn: (box, record) => control.draw(carried(box, record, page.newest)),
});
const page = { feed: 0, states: [], isOnline: false, clockMs: null };
resetFeed();

function resetFeed() {
  mosaic.clear();
  map.clear();
  earth.clear();
  series.clear();
  load.clear();
  geo.clear();
  control.clear();
  timeline.clear();
  Object.assign(page, { run: null, followed: null, lost: undefined });
  resetVideo();
}

// What the page shows begins anew: another feed, or another time.
function resetVideo() {
  page.waiting?.forEach(({ image }) => image.close());
  player.reset();
  followed.clear();
  Object.assign(page, {
    records: new Map(), trails: new Trails(), newest: null, shown: null, waiting: [], frames: 0, rate: 0, skipped: 0,
    asksStills: true, counted: performance.now(), delays: [], reason: "", video: false, lastDrawn: null,
  });
  askDrawing();
  document.getElementById("empty").hidden = false;
  screen.clear();
}

const nameOf = (header) => `${header.epoch}:${header.pts_ns ?? header.seq}`;
const utcMs = () => Date.now() + (page.clockMs ?? 0);

const connection = new Connection({
  opened: () => {
    resetFeed();
    page.isOnline = true;
    page.clockMs = null;
    if (page.feed) connection.send({ select: page.feed });
  },
  lost: () => {
    page.isOnline = false;
    refresh();
  },
  receive: async (message, payload) => {
    if (message.type === "hello") return takeHello(message.body);
    if (message.type === "state") return takeState(message.feed, message.body);
    if (message.feed !== page.feed) return undefined;
    if (message.type === "back") return goTo(message.body.s);
    if (message.type === "control") return control.take(message.body);
    if (message.type === "tracks") return takeRecord(await decompressed(payload));
    if (message.type === "skipped") return takeSkipped(message.body.frames);
    if (message.type === "video") return takePacket(message.body, payload);
    if (message.type === "mosaic") return mosaic.begin(message.body);
    if (message.type === "frame" || message.type === "tile") return takeImage(message, payload);
    return undefined;
  },
});

function takeHello(hello) {
  control.mayControl = hello.control;
  earth.basemap = hello.basemap;
}

function takeState(feed, state) {
  page.states[feed] = state;
  // The message with the shortest way tells best how far the clocks are apart.
  const apart = state.server_ms - Date.now();
  page.clockMs = page.clockMs === null ? apart : Math.max(page.clockMs, apart);
  if (feed !== page.feed) return;
  const run = state.status?.run;
  if (page.run !== null && run !== undefined && run !== page.run) page.trails.clear();
  page.run = run ?? page.run;
  control.note(state.status);
  load.note(state.status);
  timeline.limit(state.history_s);
  if (state.state === "ended") player.end();
}

function goTo(seconds) {
  resetVideo();
  timeline.show(seconds);
  control.toggle(false);
  document.getElementById("draw").disabled = seconds > 0;
}

function takeRecord(record) {
  page.records.set(nameOf(record), record);
  if (page.records.size > RECORDS_LIMIT) page.records.delete(page.records.keys().next().value);
  page.newest = record;
  page.trails.note(record);
  noteGround(record);
  // A frame that is shown with its own record stays as it is until the next one.
  if (!page.shown?.isExact) {
    if (page.shown) Object.assign(page.shown, recordFor(page.shown.header)); // it came late
    askDrawing();
  }
  if (record.pts_ns !== undefined) player.recordCame(record.epoch, record.pts_ns);
}

function noteGround(record) {
  const { reference, to_reference: toPlane } = record.registration ?? {};
  if (reference !== page.reference) geo.clear();
  page.reference = reference;
  if (!toPlane) return;
  geo.note(record.tracks.filter((track) => track.geo).map((track) => ({
    point: project(toPlane, [track.x, track.y]), lat: track.geo.lat, lon: track.geo.lon, error: track.geo.error_m,
  })).filter(({ point }) => point !== null));
}

async function takePacket({ packet, run, number }, payload) {
  await player.push(packet, { run, number }, payload);
  page.skipped += player.skipped;
  player.skipped = 0;
}

// Stills fill the time to the next keyframe.
function takeSkipped(frames) {
  page.skipped += frames;
  page.video = false;
}

async function takeImage({ type, body }, payload) {
  if (type === "frame" && !showsStills()) return;
  const [feed, tiled] = [page.feed, mosaic.newest]; // another mosaic may begin while the image is decoded
  const image = await createImageBitmap(new Blob([payload]));
  if (feed !== page.feed) image.close();
  else if (type === "tile") mosaic.take(body, image, tiled);
  else if (showsStills()) present(image, body.record, image.width, image.height);
  else image.close();
  askDrawing();
}

const showsStills = () => !page.video || player.isRefused;

function showVideo(frame, header) {
  page.video = true;
  const size = [frame.displayWidth, frame.displayHeight];
  present(frame, header, ...(header.rotation % 180 ? size.reverse() : size));
}

function present(image, header, width, height) {
  page.waiting.push({ image, header, width, height });
  if (page.waiting.length > WAITING_LIMIT) page.waiting.shift().image.close();
  askDrawing();
}

// The record of exactly this frame, or the one before it that is not older than a quarter second.
function recordFor(header) {
  const exact = page.records.get(nameOf(header));
  if (exact) return { record: exact, isExact: true };
  let record = null;
  for (const other of page.records.values()) {
    const age = header.pts_ns - other.pts_ns;
    if (other.epoch !== header.epoch || !(age >= -ROUNDING_NS && age < STALE_NS)) continue;
    if (age <= ROUNDING_NS) return { record: other, isExact: true };
    record = other;
  }
  return { record, isExact: false };
}

// Draws with the next refresh of the display; a page that shows nothing new draws nothing.
function askDrawing() {
  if (page.needsDrawing) return;
  page.needsDrawing = true;
  requestAnimationFrame(draw);
}

function draw() {
  page.needsDrawing = false;
  // The frame on which a box is being drawn stays.
  if (page.waiting.length && !pointer.box) {
    const { image, header, width, height } = page.waiting.shift();
    screen.show(image, width, height, header);
    if (page.waiting.length) askDrawing();
    page.frames += 1;
    page.shown = { header, width, height, ...recordFor(header) };
    noteDelay(header);
    document.getElementById("empty").hidden = true;
  }
  if (page.shown) {
    const { record, isExact } = page.shown;
    drawTracks(overlay, page.shown, record, page.trails, page.followed, isExact);
    page.lastDrawn = record;
    const track = record?.tracks.find(({ id }) => id === page.followed);
    followed.show(screen.picture, page.shown.width, record, page.followed, place(track?.geo));
  } else fitCanvas(overlay);
  if (pointer.box) drawBox(overlay, shownSize().size, pointer.box.from, pointer.box.to);
  map.draw(page.shown?.record ?? page.newest, page.trails, page.followed);
}

// The frame on the screen, in pixels of its record: stills may be smaller.
function shownSize() {
  const record = page.shown && page.lastDrawn;
  return { size: record?.width ? { width: record.width, height: record.height } : page.shown, record };
}

function noteDelay(header) {
  const record = page.shown.isExact ? page.shown.record : null;
  const now = utcMs();
  if (record?.published_ns) page.delays.push(now - record.published_ns / 1e6);
  if (page.delays.length > 100) page.delays.shift();
  page.ageMs = header.capture_ns ? now - header.capture_ns / 1e6 : null;
}

function refresh() {
  if (page.isOnline && page.asksStills !== showsStills()) connection.send({ stills: page.asksStills = showsStills() });
  const state = page.states[page.feed];
  const now = performance.now();
  const seconds = (now - page.counted) / 1000;
  if (seconds >= 1) {
    page.rate = page.frames / seconds;
    if (timeline.seconds === 0) series.push(sample(state));
    page.frames = 0;
    page.counted = now;
  }
  if (!page.isOnline) showState("offline", "This page has lost its connection to streamkit view; it tries again.");
  else if (state) showState(state.state, state.reason);
  const skipped = page.skipped ? `${page.skipped} frames skipped by this page.` : "";
  const reason = state && state.state !== "playing" && !page.shown ? state.reason : "";
  showNote([page.reason, reason, skipped].filter((text) => text).join(" "));
  showFeeds(page.states, page.feed, selectFeed);
  showFigures(figures(state));
  const record = page.shown?.record ?? page.newest;
  earth.draw(record, page.trails, page.followed);
  showTracks(page.newest?.tracks ?? [], page.followed, follow, (track) => geo.length([track.vx, track.vy]));
}

// What happened since the last sample, a second ago.
function sample(state) {
  const counts = [...dropsOf(state?.status).map((drop) => drop.count), ...Object.values(state?.lost ?? {}), page.skipped];
  const lost = counts.reduce((sum, count) => sum + count, 0);
  const before = page.lost ?? lost;
  page.lost = lost;
  return {
    age: page.frames ? [page.ageMs, medianDelay()].find(isPlausible) ?? null : null,
    rate: page.rate,
    lost: Math.max(0, lost - before),
    busiest: load.shares[0] ?? null,
    targets: page.newest?.tracks.filter((track) => track.state === "confirmed").length ?? null,
    registration: page.frames ? page.newest?.registration?.status : undefined,
    epoch: page.newest?.epoch,
  };
}

// Without new frames the ages are those of the last one.
const isFlowing = (state) => page.isOnline && state?.state === "playing";
const isPlausible = (age) => age !== null && age !== undefined && age > -1000 && age < PLAUSIBLE_AGE_MS;
const milliseconds = (value) => (isPlausible(value) ? `${value.toFixed(0)} ms` : "unknown");

function medianDelay() {
  const sorted = [...page.delays].sort((a, b) => a - b);
  return sorted.length ? sorted[sorted.length >> 1] : null;
}

function figures(state) {
  const status = state?.status;
  const byStream = (counts) => Object.entries(counts ?? {}).filter(([, count]) => count)
    .map(([name, count]) => `${name} ${count}`).join(", ");
  const size = page.shown ? `${page.shown.width} × ${page.shown.height}` : "none";
  const registration = page.newest?.registration;
  const rows = [
    ["video", page.shown ? `${size}, ${page.video ? "video" : "stills"}` : "none"],
    ["frame rate", `${page.rate.toFixed(1)} /s`],
    ["age on screen", milliseconds(isFlowing(state) ? page.ageMs : null)],
    ["age when published", milliseconds(isFlowing(state) ? page.newest?.age_ms : null)],
    ["published to screen", milliseconds(isFlowing(state) ? medianDelay() : null)],
    ["registration", registration ? registration.status : "none"],
    ["frames", String(status?.frames ?? 0)],
    ["epoch", String(page.newest?.epoch ?? 0)],
    ["skipped here", String(page.skipped)],
    ["lost on the way", byStream(state?.lost) || "0"],
  ];
  if (byStream(state?.bad)) rows.push(["invalid", byStream(state.bad)]);
  for (const { place: where, reason, count } of dropsOf(status).slice(0, 4)) {
    rows.push([`dropped: ${where}, ${reason}`, String(count)]);
  }
  for (const { name, share } of load.shares.slice(0, 4)) rows.push([`busy: ${name}`, `${(100 * share).toFixed(0)} %`]);
  return rows;
}

function selectFeed(feed) {
  if (feed === page.feed) return;
  page.feed = feed;
  resetFeed();
  connection.send({ select: feed });
  refresh();
}

function follow(id) {
  page.followed = page.followed === id ? null : id;
  askDrawing();
  refresh();
}

const resized = new ResizeObserver(askDrawing);
for (const id of ["overlay", "map"]) resized.observe(document.getElementById(id));
setInterval(refresh, 250);

// For tests and for the console: what is on the screen.
window.streamkit = { page, player, screen, map, mosaic, earth, medianDelay };
