// From the reference plane to the ground: an affine map fitted to the targets whose coordinates are known. It is exact
// for flat ground seen from straight above; elsewhere its residual says how far off it is.

const POINTS = 400;
const LEAST_POINTS = 6;
const METRES_PER_DEGREE = 111_320;
const SPREAD = 1e-3;
const REFIT_MS = 1000;

export class GeoFit {
  constructor() {
    this.clear();
  }

  clear() {
    this.points = [];
    this.fit = null;
    this.fitted = -Infinity;
  }

  // `points`: plane point, latitude, longitude, error in m.
  note(points) {
    this.points.push(...points);
    if (this.points.length > POINTS) this.points.splice(0, this.points.length - POINTS);
    if (points.length && performance.now() - this.fitted > REFIT_MS) {
      this.fitted = performance.now();
      this.fit = solve(this.points);
    }
  }

  // Latitude, longitude and error in m of a plane point; null where unknown.
  locate([x, y]) {
    if (!this.fit) return null;
    const { middle, origin, rows, error } = this.fit;
    const [east, north] = rows.map(([a, b, c]) => a * (x - middle[0]) + b * (y - middle[1]) + c);
    const metresEast = METRES_PER_DEGREE * Math.cos((origin[0] * Math.PI) / 180);
    return { lat: origin[0] + north / METRES_PER_DEGREE, lon: origin[1] + east / metresEast, error };
  }

  // Expected error in m of places; null where unknown.
  get error() {
    return this.fit && this.fit.error;
  }

  // Length in m of a vector of the plane; null where unknown.
  length([x, y]) {
    return this.fit && Math.hypot(...this.fit.rows.map(([a, b]) => a * x + b * y));
  }
}

function solve(points) {
  if (points.length < LEAST_POINTS) return null;
  const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
  const middle = [0, 1].map((axis) => mean(points.map(({ point }) => point[axis])));
  const origin = [mean(points.map(({ lat }) => lat)), mean(points.map(({ lon }) => lon))];
  const metresEast = METRES_PER_DEGREE * Math.cos((origin[0] * Math.PI) / 180);
  const rows = points.map(({ point, lat, lon, error }) => ({
    x: point[0] - middle[0], y: point[1] - middle[1], error,
    to: [(lon - origin[1]) * metresEast, (lat - origin[0]) * METRES_PER_DEGREE],
  }));
  const sum = (value) => rows.reduce((total, row) => total + value(row), 0);
  const [xx, xy, yy] = [sum(({ x }) => x * x), sum(({ x, y }) => x * y), sum(({ y }) => y * y)];
  const determinant = xx * yy - xy * xy;
  // Points on a line say nothing of what lies beside it.
  if (!(determinant > SPREAD * (xx + yy) ** 2)) return null;
  const fitted = [0, 1].map((axis) => {
    const [xt, yt] = [sum(({ x, to }) => x * to[axis]), sum(({ y, to }) => y * to[axis])];
    return [(xt * yy - yt * xy) / determinant, (yt * xx - xt * xy) / determinant, 0];
  });
  const residual = ({ x, y, to }) => Math.hypot(...fitted.map(([a, b], axis) => a * x + b * y - to[axis]));
  const rms = Math.sqrt(mean(rows.map((row) => residual(row) ** 2)));
  const errors = rows.map(({ error }) => error).filter((error) => error !== undefined).sort((a, b) => a - b);
  const known = errors.length ? errors[errors.length >> 1] : 0;
  return { middle, origin, rows: fitted, error: Math.hypot(rms, known) };
}
