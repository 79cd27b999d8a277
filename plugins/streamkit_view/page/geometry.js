// Homographies as rows of a 3x3 matrix, as in the records, boxes, and distances.

export function inverse([[a, b, c], [d, e, f], [g, h, i]]) {
  const rows = [
    [e * i - f * h, c * h - b * i, b * f - c * e],
    [f * g - d * i, a * i - c * g, c * d - a * f],
    [d * h - e * g, b * g - a * h, a * e - b * d],
  ];
  const determinant = a * rows[0][0] + b * rows[1][0] + c * rows[2][0];
  return Math.abs(determinant) > 1e-12 ? rows.map((row) => row.map((value) => value / determinant)) : null;
}

export function project(matrix, [x, y]) {
  const [u, v, w] = matrix.map((row) => row[0] * x + row[1] * y + row[2]);
  return w === 0 ? null : [u / w, v / w];
}

export function corners({ x, y, length, width, angle }) {
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  return [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([along, across]) => [
    x + (along * length * cos - across * width * sin) / 2,
    y + (along * length * sin + across * width * cos) / 2,
  ]);
}

// The item of the smallest distance, if that is below a limit.
export function nearest(items, distance, limit) {
  const [found] = items.map((item) => ({ item, apart: distance(item) })).sort((a, b) => a.apart - b.apart);
  return found?.apart < limit ? found.item : undefined;
}
