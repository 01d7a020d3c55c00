// SPDX-License-Identifier: Apache-2.0
// Palettes as the colours of vertices.
import * as THREE from 'three';
import {palettes} from './colours.js';

const kUnknown = [0.42, 0.42, 0.44];

// Colours of a screen as the linear ones in which three.js computes.
function linearTable(palette) {
  const colour = new THREE.Color();
  const table = new Float32Array(palette.length);
  for (let i = 0; i < palette.length; i += 3) {
    colour.setRGB(palette[i] / 255, palette[i + 1] / 255, palette[i + 2] / 255, THREE.SRGBColorSpace);
    colour.toArray(table, i);
  }
  return table;
}

// `levelOf`: from 0 to 255 of the i-th, null where it is unknown.
export function byPalette(count, name, levelOf) {
  const table = linearTable(palettes[name]);
  const colours = new Float32Array(3 * count);
  for (let i = 0; i < count; ++i) {
    const level = levelOf(i);
    colours.set(level === null ? kUnknown : table.subarray(3 * level, 3 * level + 3), 3 * i);
  }
  return colours;
}
