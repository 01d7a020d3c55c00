// SPDX-License-Identifier: Apache-2.0
// The map as a surface or points, in one of its colourings.
import * as THREE from 'three';
import {data, unpacked} from '../shared/data.js';
import {fixed, short} from '../shared/format.js';
import {byPalette} from '../shared/vertex_colours.js';

async function geometryOf(map) {
  const [x, y, z, indices] = await Promise.all([
    unpacked(map.x, Uint16Array), unpacked(map.y, Uint16Array), unpacked(map.z, Uint16Array),
    unpacked(map.indices, Uint32Array),
  ]);
  const positions = new Float32Array(3 * map.vertices);
  for (let i = 0; i < map.vertices; ++i) {
    positions[3 * i] = map.origin[0] + map.step_m * x[i];
    positions[3 * i + 1] = map.origin[1] + map.step_m * y[i];
    positions[3 * i + 2] = map.origin[2] + map.step_m * z[i];
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
  if (map.triangles > 0) {
    geometry.setIndex(new THREE.BufferAttribute(indices, 1));
    geometry.computeVertexNormals();
  }
  return geometry;
}

function heightColouring(positions, count) {
  const heights = Float32Array.from({length: count}, (_, i) => positions[3 * i + 2]);
  const sorted = [...heights].sort((a, b) => a - b);
  const low = sorted[Math.floor(0.005 * count)];
  const high = Math.max(low + 1e-6, sorted[Math.floor(0.995 * (count - 1))]);
  const level = (i) => Math.round(255 * Math.max(0, Math.min(1, (heights[i] - low) / (high - low))));
  const digits = high - low < 0.05 ? 4 : 2;
  return {
    label: 'height',
    colours: byPalette(count, 'cividis', level),
    bar: ['cividis', ...[low, (low + high) / 2, high].map((value) => `${fixed(value, digits)} m`)],
  };
}

async function colouringsOf(map, positions) {
  const grey = await unpacked(map.grey, Uint8Array);
  const light = new Float32Array(3 * map.vertices);
  for (let i = 0; i < map.vertices; ++i) light.fill(Math.min(1, grey[i] / map.white), 3 * i, 3 * i + 3);
  const colourings = {
    texture: {label: 'texture', colours: light, bar: null},
    height: heightColouring(positions, map.vertices),
  };
  if (map.error) {
    const error = await unpacked(map.error, Uint8Array);
    const limit = `${short(map.error_limit_mm)} mm`;
    colourings.error = {
      label: 'error',
      colours: byPalette(map.vertices, 'diverging', (i) => (error[i] ? Math.round(((error[i] - 1) * 255) / 254) : null)),
      bar: ['diverging', `−${limit}`, '0', `+${limit}`],
    };
  }
  return colourings;
}

// Returns {surface, points, box, colourings}; surface is null for a map without triangles.
export async function mapModel() {
  const {map} = data;
  const geometry = await geometryOf(map);
  const colourings = await colouringsOf(map, geometry.attributes.position.array);
  geometry.setAttribute('color', new THREE.BufferAttribute(colourings.texture.colours, 3));
  geometry.computeBoundingBox();
  const size = geometry.boundingBox.getSize(new THREE.Vector3()).length();
  const spacing = map.cell_mm > 0 ? map.cell_mm / 1000 : size / Math.sqrt(map.vertices) / 2;
  const points = new THREE.Points(geometry, new THREE.PointsMaterial({size: 1.3 * spacing, vertexColors: true}));
  const surface = map.triangles > 0
    ? new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({vertexColors: true, side: THREE.DoubleSide}))
    : null;
  return {
    surface,
    points,
    box: geometry.boundingBox,
    colourings,
    colourBy(name) {
      geometry.setAttribute('color', new THREE.BufferAttribute(colourings[name].colours, 3));
    },
  };
}
