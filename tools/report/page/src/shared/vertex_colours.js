// SPDX-License-Identifier: Apache-2.0
// Palettes as vertex colours.
import * as THREE from 'three';
import {palettes} from './colours.js';

const kUnknown = [0.42, 0.42, 0.44];

// Converts display colours to linear ones, as used by three.js.
function linearTable(palette) {
  const colour = new THREE.Color();
  const table = new Float32Array(palette.length);
  for (let i = 0; i < palette.length; i += 3) {
    colour.setRGB(palette[i] / 255, palette[i + 1] / 255, palette[i + 2] / 255, THREE.SRGBColorSpace);
    colour.toArray(table, i);
  }
  return table;
}

// `levelOf(i)`: level from 0 to 255, null if unknown.
export function byPalette(count, name, levelOf) {
  const table = linearTable(palettes[name]);
  const colours = new Float32Array(3 * count);
  for (let i = 0; i < count; ++i) {
    const level = levelOf(i);
    colours.set(level === null ? kUnknown : table.subarray(3 * level, 3 * level + 3), 3 * i);
  }
  return colours;
}
