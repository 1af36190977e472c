// The line of means through a cloud of residuals, where it says more than chance does.
// Many rows are counted by the server, by the same rule: figures/means.py.

const ABOVE = 5; // standard deviations of chance
const FEWEST = 6; // rows more than parts

const LEAN = 4; // rows for which the usual scatter counts
const NOTHING = 1e-12; // readings that are all the same

function middle(values) {
  const [sorted, half] = [values.toSorted((a, b) => a - b), values.length / 2];
  return (sorted[Math.floor(half - 0.5)] + sorted[Math.ceil(half - 0.5)]) / 2;
}

/** What lies across and the mean, part by part; one level where only that is seen; or nothing. */
export function meanLine(x, y, part, parts) {
  const sums = Array.from({length: parts}, () => [0, 0, 0]);
  part.forEach((k, i) => { sums[k][0] += x[i]; sums[k][1] += y[i]; sums[k][2] += 1; });
  const filled = sums.filter(([, , n]) => n);
  const points = filled.map(([at, v, n]) => [at / n, v / n]);
  const free = y.length - points.length;
  if (points.length < 2 || free < FEWEST) return points;
  const inside = sums.map(() => 0);
  part.forEach((k, i) => { inside[k] += (y[i] - sums[k][1] / sums[k][2]) ** 2; });
  const usual = middle(sums.flatMap(([, , n], k) => (n > 1 ? [inside[k] / (n - 1)] : [])));
  const weight = sums.flatMap(([, , n], k) =>
    (n ? [n / ((inside[k] + LEAN * usual) / (n - 1 + LEAN) + NOTHING)] : []));
  const all = weight.reduce((a, b) => a + b, 0);
  const level = points.reduce((s, [, v], k) => s + weight[k] * v, 0) / all;
  const apart = points.reduce((s, [, v], k) => s + weight[k] * (v - level) ** 2, 0);
  const shape = points.length - 1;
  if (apart > shape + ABOVE * Math.sqrt(2 * shape)) return points;
  if (level ** 2 * all > ABOVE ** 2) return [[points[0][0], level], [points.at(-1)[0], level]];
  return [];
}
