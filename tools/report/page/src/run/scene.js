// SPDX-License-Identifier: Apache-2.0
// The map in 3D, with the paths and frusta of the camera.
import * as THREE from 'three';
import {colourBar} from '../shared/colour_bar.js';
import {inks} from '../shared/colours.js';
import {data} from '../shared/data.js';
import {byId, checkbox, element} from '../shared/dom.js';
import {count, fixed} from '../shared/format.js';
import {theme} from '../shared/theme.js';
import {mapModel} from './map_model.js';
import {Orbit} from './orbit.js';
import {errorScale, paths, positions} from './paths.js';
import {store} from './store.js';
import {warmMarks} from './warm_things.js';

function notice(text) {
  byId('scene-notice').textContent = text;
  byId('scene-notice').hidden = false;
}

function rendererOn(canvas) {
  try {
    return new THREE.WebGLRenderer({canvas, antialias: true});
  } catch {
    return null;
  }
}

// A grid under the map whose squares have a round size.
function floorGrid(box) {
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

function lights(camera) {
  const key = new THREE.DirectionalLight(0xffffff, 1.5);
  key.position.set(0.4, 0.7, 1);
  camera.add(key);
  return [new THREE.AmbientLight(0xffffff, 1.9), camera];
}

function legend(entries) {
  byId('legend').replaceChildren(...entries.map(([ink, text, kind]) =>
    element('span', {class: 'entry'}, element('i', {class: `ink ${kind ?? ''}`, style: `--ink: var(--${ink})`}), text)));
}

function choice(label, options, change) {
  const select = element('select', {'aria-label': label, onchange: () => change(select.value)},
    ...options.map(([value, text]) => element('option', {value}, text)));
  return element('label', {class: 'choice'}, element('span', {}, label), select);
}

function showMapBar(colouring) {
  byId('map-bar').replaceChildren(...(colouring.bar ? [colourBar(...colouring.bar)] : []));
}

export async function showScene() {
  const canvas = byId('scene');
  const cameras = positions();
  canvas.setAttribute('aria-label', `Map of ${data.name} in 3D with the camera's path`);
  if (!data.map && cameras.length === 0) return notice('No view was tracked: there is no map.');
  const renderer = rendererOn(canvas);
  if (!renderer) return notice('This browser shows no WebGL 2: the map cannot be drawn here. mesh.glb beside the report holds it.');

  const model = data.map ? await mapModel() : null;
  const box = model?.box ?? new THREE.Box3().setFromPoints(cameras).expandByScalar(0.1);
  const scale = errorScale(box.getSize(new THREE.Vector3()).length());
  const drawn = paths(scale);
  const {grid, square} = floorGrid(box);
  const warm = warmMarks();

  let asked = false;
  const redraw = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(draw);
  };
  const orbit = new Orbit(canvas, box, cameras, redraw);
  const scene = new THREE.Scene();
  scene.add(...lights(orbit.camera), drawn.group, grid);
  if (warm) scene.add(warm.group);
  if (model) scene.add(...[model.surface, model.points].filter(Boolean));

  function draw(now) {
    asked = false;
    const moves = orbit.update(now);
    renderer.render(scene, orbit.camera);
    canvas.dataset.drawn = 'true';
    if (moves) redraw();
  }

  const controls = byId('scene-controls');
  const shown = (label, object, on = true) =>
    checkbox(label, on, (checked) => {
      object.visible = checked;
      redraw();
    });
  if (model) {
    const names = Object.entries(model.colourings).map(([name, {label}]) => [name, label]);
    controls.append(choice('colour', names, (name) => {
      model.colourBy(name);
      showMapBar(model.colourings[name]);
      redraw();
    }));
    model.points.visible = !model.surface;
    if (model.surface) {
      controls.append(choice('as', [['surface', 'surface'], ['points', 'points']], (kind) => {
        model.surface.visible = kind === 'surface';
        model.points.visible = kind === 'points';
        redraw();
      }));
    }
  }
  controls.append(shown('frusta', drawn.frusta), shown('estimated path', drawn.estimate));
  if (data.has_truth) controls.append(shown('true path', drawn.truth));
  if (scale) controls.append(shown(`errors × ${count(scale)}`, drawn.errors, false));
  controls.append(shown('grid', grid));
  if (warm) controls.append(shown('warm things', warm.group));
  const look = () => {
    const view = data.views[store.view];
    const pose = view.pose ?? view.true_pose;
    if (pose) orbit.flyTo(pose);
  };
  controls.append(
    element('button', {type: 'button', class: 'button', id: 'look', onclick: look}, 'From this view'),
    element('button', {type: 'button', class: 'button', id: 'reset', onclick: () => orbit.reset()}, 'Reset'));
  canvas.addEventListener('keydown', (event) => {
    if (event.key === 'v' || event.key === 'V') look();
  });

  const entries = [['estimate', 'estimated path']];
  if (data.has_truth) entries.push(['truth', 'true path', 'dashed']);
  if (warm) entries.push(['lost', 'victim?'], ['third', 'warm, no victim']);
  entries.push(['chosen', 'this view'], ['floor', `squares of ${square < 0.1 ? `${fixed(square * 1000, 0)} mm` : `${fixed(square, square < 1 ? 1 : 0)} m`}`]);
  legend(entries);

  theme.on((dark) => {
    const ink = inks(dark);
    scene.background = new THREE.Color(ink.paper);
    grid.material.color.set(ink.floor);
    drawn.colour();
    warm?.colour(dark);
    redraw();
  });
  store.onView((place) => {
    drawn.choose(data.views[place]);
    redraw();
  });
  const fit = () => {
    const {clientWidth: width, clientHeight: height} = canvas.parentElement;
    renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    renderer.setSize(width, height, false);
    orbit.resize(width, height);
  };
  new ResizeObserver(fit).observe(canvas.parentElement);
  fit();
}
