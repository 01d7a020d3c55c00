// SPDX-License-Identifier: Apache-2.0
const kUnknown = '–';

function isNumber(value) {
  return typeof value === 'number' && Number.isFinite(value);
}

// Formats with a true minus sign, but without one before zero.
export function fixed(value, digits) {
  if (!isNumber(value)) return kUnknown;
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace('-', '') : text.replace('-', '−');
}

// At least three digits, all of them significant.
export function figure(value) {
  if (!isNumber(value)) return kUnknown;
  const size = Math.abs(value);
  if (size === 0) return '0';
  if (size < 1e-5) return value.toExponential(1).replace('e-', 'e−');
  return fixed(value, Math.max(0, Math.min(6, 2 - Math.floor(Math.log10(size)))));
}

// The shortest form of a round value.
export function short(value) {
  return String(Number(value.toPrecision(3)));
}

// Four significant digits without trailing zeros.
export function amount(value) {
  return isNumber(value) ? String(Number(value.toPrecision(4))).replaceAll('-', '−') : kUnknown;
}

export function percent(share, digits = 1) {
  return isNumber(share) ? `${fixed(share * 100, digits)}\u00a0%` : kUnknown;
}

export function count(value) {
  return isNumber(value) ? value.toLocaleString('en').replaceAll(',', '\u202f') : kUnknown;
}

export function plural(number, noun) {
  return `${count(number)} ${noun}${number === 1 ? '' : 's'}`;
}
