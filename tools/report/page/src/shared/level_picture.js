// SPDX-License-Identifier: Apache-2.0
// A picture of levels (0 unknown, 1 to 255 from low to high) in a palette's colours, which can be queried for values.
import {palettes} from './colours.js';

async function levelsOf(url) {
  const image = new Image();
  image.src = url;
  await image.decode();
  const canvas = new OffscreenCanvas(image.width, image.height);
  const context = canvas.getContext('2d', {willReadFrequently: true});
  context.drawImage(image, 0, 0);
  const pixels = context.getImageData(0, 0, image.width, image.height).data;
  const levels = new Uint8Array(pixels.length / 4);
  for (let i = 0; i < levels.length; ++i) levels[i] = pixels[4 * i];
  return {width: image.width, height: image.height, levels};
}

function painted({width, height, levels}, palette) {
  const picture = new ImageData(width, height);
  for (let i = 0; i < levels.length; ++i) {
    if (levels[i] === 0) continue;
    const colour = 3 * Math.round(((levels[i] - 1) * 255) / 254);
    picture.data.set(palette.subarray(colour, colour + 3), 4 * i);
    picture.data[4 * i + 3] = 255;
  }
  return picture;
}

export class LevelPicture {
  constructor(canvas, paletteName) {
    this.canvas = canvas;
    this.palette = palettes[paletteName];
    this.shown = null;
    this.wanted = null;
  }

  async show(url) {
    this.wanted = url;
    const picture = url ? await levelsOf(url) : null;
    if (this.wanted !== url) return;  // another picture was chosen meanwhile
    this.shown = picture;
    if (!picture) return;
    this.canvas.width = picture.width;
    this.canvas.height = picture.height;
    this.canvas.getContext('2d').putImageData(painted(picture, this.palette), 0, 0);
  }

  // Calls `show` with the value under the pointer, null if unknown, and with undefined when the pointer leaves.
  onPointer(show) {
    this.canvas.addEventListener('pointermove', (event) => {
      const box = this.canvas.getBoundingClientRect();
      show(this.at((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height));
    });
    this.canvas.addEventListener('pointerleave', () => show(undefined));
  }

  // Returns the value from 0 (low) to 1 (high), or null if unknown. Coordinates are fractions of width and height.
  at(x, y) {
    if (!this.shown) return null;
    const {width, height, levels} = this.shown;
    const level = levels[Math.min(height - 1, Math.floor(y * height)) * width + Math.min(width - 1, Math.floor(x * width))];
    return level ? (level - 1) / 254 : null;
  }
}
