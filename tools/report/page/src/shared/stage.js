// SPDX-License-Identifier: Apache-2.0
// Common parts of the 3D views: renderer, floor grid, legend.
import * as THREE from 'three';
import {byId, element} from './dom.js';
import {fixed} from './format.js';

// Whether the browser draws without a GPU. There, smooth edges and anisotropic textures triple the time of a frame.
export const drawsInSoftware = (() => {
  const gl = document.createElement('canvas').getContext('webgl2');
  const about = gl?.getExtension('WEBGL_debug_renderer_info');
  const renderer = about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : '';
  gl?.getExtension('WEBGL_lose_context')?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(renderer);
})();

// Returns null without WebGL 2.
export function rendererOn(canvas) {
  try {
    return new THREE.WebGLRenderer({canvas, antialias: !drawsInSoftware});
  } catch {
    return null;
  }
}

// A grid below the map whose squares have a round size.
export function floorGrid(box) {
  const size = box.getSize(new THREE.Vector3());
  const extent = Math.max(size.x, size.y);
  const decade = 10 ** Math.floor(Math.log10(extent / 4));
  const square = [1, 2, 5].map((step) => step * decade).filter((step) => step <= extent / 4).pop() ?? decade;
  const squares = 2 * Math.ceil((0.7 * extent) / square);
  const grid = new THREE.GridHelper(squares * square, squares);
  grid.rotateX(Math.PI / 2);
  const centre = box.getCenter(new THREE.Vector3());
  grid.position.set(centre.x, centre.y, box.min.z - 0.01 * extent);
  grid.material.vertexColors = false;
  return {grid, square};
}

// Returns the size of a square as text.
export function squareSize(square) {
  return square < 0.1 ? `${fixed(square * 1000, 0)} mm` : `${fixed(square, square < 1 ? 1 : 0)} m`;
}

// Entries are [ink, text, kind of line].
export function legend(entries) {
  byId('legend').replaceChildren(...entries.map(([ink, text, kind]) =>
    element('span', {class: 'entry'}, element('i', {class: `ink ${kind ?? ''}`, style: `--ink: var(--${ink})`}), text)));
}

// Fits a renderer to its canvas and updates the viewpoint's aspect ratio.
export function fitted(renderer, canvas, orbit) {
  const fit = () => {
    const {clientWidth: width, clientHeight: height} = canvas.parentElement;
    renderer.setPixelRatio(Math.min(drawsInSoftware ? 1 : 2, devicePixelRatio));
    renderer.setSize(width, height, false);
    orbit.resize(width, height);
  };
  new ResizeObserver(fit).observe(canvas.parentElement);
  fit();
}
