// SPDX-License-Identifier: Apache-2.0
// Scales that map values to pixels, and tick values of axes.

// `from`: values at both ends; `to`: pixels at both ends.
export function linear(from, to) {
  const slope = (to[1] - to[0]) / (from[1] - from[0] || 1);
  const scale = (value) => to[0] + slope * (value - from[0]);
  return Object.assign(scale, {from, to, ticks: (count) => linearTicks(from, count)});
}

// Values up to 0 map to the lower end.
export function logarithmic(from, to) {
  const inner = linear(from.map(Math.log10), to);
  const scale = (value) => inner(Math.log10(Math.max(value, from[0])));
  return Object.assign(scale, {from, to, ticks: (count) => logTicks(from, count)});
}

// Centres of cells of equal width, one per name.
export function categories(names, to) {
  const width = (to[1] - to[0]) / names.length;
  const scale = (place) => to[0] + (place + 0.5) * width;
  return Object.assign(scale, {from: [0, names.length - 1], to, width, ticks: () => names.map((_, place) => place)});
}

function linearTicks([low, high], count) {
  const rough = (high - low) / count || 1;
  const decade = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * decade).find((size) => size >= rough * 0.999);
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; ++k) ticks.push(Number((k * step).toPrecision(12)));
  return ticks;
}

// Whole decades; if they are few, also 2 and 5 of each.
function logTicks([low, high], count) {
  const first = Math.ceil(Math.log10(low) - 1e-9);
  const last = Math.floor(Math.log10(high) + 1e-9);
  const every = Math.max(1, Math.ceil((last - first + 1) / count));
  const decades = [];
  for (let decade = first; decade <= last; decade += every) decades.push(10 ** decade);
  if (decades.length > 2 || every > 1) return decades.map(clean);
  const more = [];
  for (let decade = first - 1; decade <= last; ++decade) {
    for (const factor of [1, 2, 5]) more.push(factor * 10 ** decade);
  }
  return more.filter((tick) => tick >= low * 0.999 && tick <= high * 1.001).map(clean);
}

function clean(value) {
  return Number(value.toPrecision(6));
}

// Whole decades around the positive values; null if there are none.
export function decadesAround(values) {
  const known = values.filter((value) => value > 0);
  if (known.length === 0) return null;
  const low = Math.floor(Math.log10(Math.min(...known)));
  return [10 ** low, 10 ** Math.max(low + 1, Math.ceil(Math.log10(Math.max(...known))))];
}
