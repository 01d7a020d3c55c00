// SPDX-License-Identifier: Apache-2.0
// Palettes suitable for colour-blind readers: viridis (van der Walt, Smith 2015) and cividis (Nunez et al. 2018) for
// magnitudes, blue - white - orange for signed errors, and lit - in shadow - outside the beam, after Okabe and Ito.
const kStops = {
  viridis: ['440154', '482878', '3e4989', '31688e', '26828e', '1f9e89', '35b779', '6ece58', 'b5de2b', 'fde725'],
  cividis: ['00224e', '123570', '3b496c', '575d6d', '707173', '8a8678', 'a59c74', 'c3b369', 'e1cc55', 'fee838'],
  lights: ['f0e442', '0072b2', '8c8c8c'],
  diverging: ['053c75', '1f6cb5', '6ba6dc', 'bcd7ef', 'f4f3f0', 'f8d6ae', 'eea257', 'd06a12', '8a3c04'],
};

function channels(hex) {
  return [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16));
}

// Returns 256 colours, r g b r g b …
function table(stops) {
  const colours = stops.map(channels);
  const result = new Uint8Array(768);
  for (let i = 0; i < 256; ++i) {
    const place = (i / 255) * (colours.length - 1);
    const low = Math.min(Math.floor(place), colours.length - 2);
    for (let c = 0; c < 3; ++c) {
      result[3 * i + c] = Math.round(colours[low][c] + (place - low) * (colours[low + 1][c] - colours[low][c]));
    }
  }
  return result;
}

export const palettes = Object.fromEntries(Object.entries(kStops).map(([name, stops]) => [name, table(stops)]));

export function gradient(name) {
  return `linear-gradient(to right, ${kStops[name].map((stop) => `#${stop}`).join(', ')})`;
}

// Colours of lines and marks, after Okabe and Ito.
export function inks(dark) {
  return dark
    ? {estimate: '#56b4e9', truth: '#f0a830', chosen: '#f07ec0', lost: '#ff7a45', third: '#2fc79a', text: '#c9cdd4', grid: '#343a44', paper: '#14171c', band: 'rgba(86,180,233,0.22)', quiet: 'rgba(160,168,180,0.16)', frustum: '#8fa3b8', floor: '#39414d'}
    : {estimate: '#0067a8', truth: '#d98200', chosen: '#b8367f', lost: '#c44601', third: '#00805c', text: '#3b414b', grid: '#e2e5ea', paper: '#f3f5f8', band: 'rgba(0,103,168,0.16)', quiet: 'rgba(60,70,85,0.10)', frustum: '#6c7f93', floor: '#cdd4dd'};
}
