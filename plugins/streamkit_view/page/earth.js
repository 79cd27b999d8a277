// The geographic map, by MapLibre GL: targets with their trails, the camera's footprint, the mosaic, and a base map if
// the server has one. It is loaded when the first ground coordinates come. Nothing is fetched from elsewhere.

import { nearest, project } from "./geometry.js";
import { byId, element } from "./panel.js";

const FIT = { padding: 40, maxZoom: 19, duration: 0 };
const CLICK_PX = 12; // around a target
const EMPTY = { type: "FeatureCollection", features: [] };
const COLOUR = ["case", ["get", "followed"], "#32d7ff", "#ffd60a"];
const is = (kind) => ["==", ["get", "kind"], kind];
const LAYERS = [
  { id: "footprint", type: "line", filter: is("footprint"), paint: { "line-color": "#32d7ff", "line-width": 1.5 } },
  { id: "trails", type: "line", filter: is("trail"), paint: { "line-color": COLOUR, "line-width": 1.5 } },
  { id: "targets", type: "circle", filter: is("target"),
    paint: { "circle-color": COLOUR, "circle-radius": ["case", ["get", "followed"], 6, 4] } },
].map((layer) => ({ ...layer, source: "live" }));

export class EarthMap {
  // `geo` tells where a point of the plane lies; `chosen(id)` is called when a target is clicked.
  constructor(container, section, { geo, mosaic, chosen }) {
    Object.assign(this, { container, section, geo, mosaic, chosen, basemap: null, map: null, targets: [], isReady: false });
    byId("earth-fit").addEventListener("click", () => this.fit());
  }

  clear() {
    this.section.hidden = true;
    this.isFitted = this.isMoved = false;
    this.bounds = null;
    this.targets = [];
    if (!this.isReady) return;
    this.map.getSource("live").setData(EMPTY);
    this.removeMosaic();
  }

  draw(record, trails, followed) {
    const features = record ? featuresOf(record, trails, followed, this.geo) : [];
    if (features.length === 0 || this.cannot) return;
    this.section.hidden = false;
    if (!this.loading) this.loading = this.load().catch((error) => this.fail(error));
    if (!this.isReady) return;
    this.targets = features.filter(({ properties }) => properties.kind === "target");
    this.bounds = boundsOf(features);
    this.map.getSource("live").setData({ type: "FeatureCollection", features });
    this.showMosaic(this.mosaic.corners(record));
    const shown = this.map.getBounds();
    if (!this.isFitted || (!this.isMoved && !this.bounds.every((corner) => shown.contains(corner)))) this.fit();
  }

  fit() {
    if (!this.isReady || !this.bounds) return;
    this.isFitted = true;
    this.isMoved = false;
    this.map.fitBounds(this.bounds, FIT);
  }

  async load() {
    const { Map, ScaleControl, addProtocol } = await import("./maplibre-gl.mjs");
    const style = { version: 8, sources: { live: { type: "geojson", data: EMPTY } }, layers: [...LAYERS] };
    await addBasemap(style, this.basemap, addProtocol);
    const map = new Map({
      container: this.container, style, attributionControl: false, fadeDuration: 0, maxPitch: 0, dragRotate: false,
      locale: { "Map.Title": "Geographic map. Arrow keys pan, plus and minus zoom." },
    });
    map.touchZoomRotate.disableRotation();
    map.addControl(new ScaleControl());
    map.on("error", ({ error }) => console.warn(`geographic map: ${error?.message}`));
    map.on("movestart", ({ originalEvent }) => { if (originalEvent) this.isMoved = true; });
    map.on("mousemove", ({ lngLat }) => this.describe(lngLat));
    // By the newest places: what is rendered may be of an earlier record.
    map.on("click", ({ point }) => {
      const pixels = ({ geometry }) => map.project(geometry.coordinates).dist(point);
      const target = nearest(this.targets, pixels, CLICK_PX);
      if (target) this.chosen(target.properties.id);
    });
    await map.once("load");
    this.map = map;
    this.isReady = true;
  }

  fail(error) {
    this.cannot = true;
    console.warn(`geographic map: ${error.message}`);
    this.section.hidden = false;
    byId("earth-cursor").textContent = "This browser cannot draw the geographic map; it needs WebGL.";
  }

  describe({ lng, lat }) {
    const error = this.geo.error === null ? "" : ` ± ${this.geo.error.toFixed(1)} m`;
    byId("earth-cursor").textContent = `${lat.toFixed(6)}, ${lng.toFixed(6)}${error}`;
  }

  showMosaic(corners) {
    const coordinates = corners.map((corner) => lonLat(this.geo, corner));
    if (coordinates.length === 0 || coordinates.includes(null)) return this.removeMosaic();
    const { canvas, version } = this.mosaic.shown;
    const source = this.map.getSource("mosaic");
    if (source?.getCanvas() === canvas) {
      if (version !== this.versionShown) source.play(); // reads the canvas again
      source.pause();
      this.versionShown = version;
      return source.setCoordinates(coordinates);
    }
    this.removeMosaic();
    this.versionShown = version;
    this.map.addSource("mosaic", { type: "canvas", canvas, animate: false, coordinates });
    return this.map.addLayer({ id: "mosaic", type: "raster", source: "mosaic" }, "footprint");
  }

  removeMosaic() {
    if (!this.map.getSource("mosaic")) return;
    this.map.removeLayer("mosaic");
    this.map.removeSource("mosaic");
  }
}

function lonLat(geo, point) {
  const found = point && geo.locate(point);
  return found ? [found.lon, found.lat] : null;
}

function featuresOf(record, trails, followed, geo) {
  const toPlane = record.registration?.to_reference;
  const onGround = (points) => points.map((point) => lonLat(geo, point)).filter((place) => place !== null);
  const feature = (type, coordinates, properties) => ({
    type: "Feature", geometry: { type, coordinates }, properties: { followed: false, ...properties },
  });
  const found = [];
  for (const track of record.tracks) {
    if (track.state === "lost" || track.state === "tentative") continue;
    const point = toPlane ? project(toPlane, [track.x, track.y]) : null;
    const place = track.geo ? [track.geo.lon, track.geo.lat] : lonLat(geo, point);
    if (place === null) continue;
    const properties = { id: track.id, followed: track.id === followed };
    const trail = toPlane ? onGround(trails.onPlane(track.id)) : [];
    if (trail.length > 1) found.push(feature("LineString", trail, { kind: "trail", ...properties }));
    found.push(feature("Point", place, { kind: "target", ...properties }));
  }
  const [width, height] = [record.width, record.height];
  const frame = [[0, 0], [width, 0], [width, height], [0, height], [0, 0]];
  const footprint = toPlane ? onGround(frame.map((corner) => project(toPlane, corner))) : [];
  if (footprint.length === frame.length) found.push(feature("LineString", footprint, { kind: "footprint" }));
  return found;
}

function boundsOf(features) {
  const places = features.flatMap(({ geometry: { type, coordinates } }) => (type === "Point" ? [coordinates] : coordinates));
  return [Math.min, Math.max].map((pick) => [0, 1].map((axis) => pick(...places.map((place) => place[axis]))));
}

// A vector archive is drawn as outlines and pale areas, without text: its fonts would be elsewhere.
async function addBasemap(style, basemap, addProtocol) {
  if (!basemap) return;
  const url = new URL("basemap", location.href).href;
  if (basemap.corners.length) {
    style.sources.base = { type: "image", url, coordinates: basemap.corners };
    style.layers.unshift({ id: "base", type: "raster", source: "base" });
    return;
  }
  const { PMTiles, Protocol, TileType } = await loadPMTiles();
  const [archive, protocol] = [new PMTiles(url), new Protocol()];
  protocol.add(archive);
  addProtocol("pmtiles", protocol.tile);
  const isVector = (await archive.getHeader()).tileType === TileType.Mvt;
  style.sources.base = { type: isVector ? "vector" : "raster", url: `pmtiles://${url}`, ...(isVector ? {} : { tileSize: 256 }) };
  if (!isVector) return void style.layers.unshift({ id: "base", type: "raster", source: "base" });
  const names = ((await archive.getMetadata()).vector_layers ?? []).map(({ id }) => id);
  style.layers.unshift(...names.flatMap((name) => [
    { id: `${name} areas`, type: "fill", source: "base", "source-layer": name, filter: ["==", ["geometry-type"], "Polygon"],
      paint: { "fill-color": "#8a94a3", "fill-opacity": 0.15 } },
    { id: `${name} lines`, type: "line", source: "base", "source-layer": name, paint: { "line-color": "#6d7889" } },
  ]));
}

function loadPMTiles() {
  return new Promise((done, failed) => {
    const script = element("script", null, { src: "pmtiles.js" });
    script.addEventListener("load", () => done(window.pmtiles));
    script.addEventListener("error", () => failed(new Error("pmtiles.js cannot be loaded")));
    document.head.append(script);
  });
}
