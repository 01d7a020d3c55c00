// SPDX-License-Identifier: Apache-2.0
// A scene: its world in 3D, the rig along its path, and its objects.
import {byId, element} from '../shared/dom.js';
import {fixed} from '../shared/format.js';
import {drawPage} from '../shared/page.js';
import {askForToken} from '../shared/token.js';
import {ask, Refused, readToken} from '../live/server.js';
import {SensorPanel} from './sensor.js';
import {World} from './world.js';

const kMostListed = 500;

async function sceneData() {
  for (;;) {
    try {
      return await (await ask('/scene')).json();
    } catch (error) {
      if (!(error instanceof Refused) || error.status !== 401) throw error;
      byId('status').textContent = 'Token required';
      await askForToken();
    }
  }
}

function showSelected(object) {
  const [x, y, z] = object.pose;
  const facts = [['name', object.name], ['material', object.material], ['position', `${[x, y, z].map((value) => fixed(value, 3)).join(', ')} m`],
    ['quaternion x y z w', object.pose.slice(3).map((value) => fixed(value, 3)).join(', ')]];
  byId('selected').replaceChildren(...facts.flatMap(([name, value]) => [element('dt', {}, name), element('dd', {}, value)]));
}

function listObjects(scene, world) {
  const buttons = scene.objects.slice(0, kMostListed).map((object, i) =>
    element('button', {type: 'button', class: 'button', 'aria-pressed': 'false', onclick: () => world.select(i)}, `${object.name}: ${object.material}`));
  byId('object-list').append(...buttons.map((button) => element('li', {}, button)));
  if (scene.objects.length > kMostListed) byId('more').textContent = `and ${scene.objects.length - kMostListed} more; click them in the world`;
  world.onSelect = (i) => {
    buttons.forEach((button, k) => button.setAttribute('aria-pressed', String(k === i)));
    buttons[i]?.scrollIntoView({block: 'nearest'});
    showSelected(scene.objects[i]);
  };
}

function connectSlider(scene, world, sensor) {
  const slider = byId('time');
  slider.max = scene.path.length - 1;
  const show = () => {
    const index = Number(slider.value);
    const {time_s} = scene.path[index];
    const text = scene.continuous ? `${fixed(time_s, 2)} s` : `view ${index}`;
    byId('time-text').textContent = text;
    slider.setAttribute('aria-valuetext', text);
    world.showRig(scene.path[index]);
    sensor.at(index);
  };
  slider.addEventListener('input', show);
  show();
}

async function showScene() {
  const scene = await sceneData();
  byId('name').textContent = scene.name;
  document.title = `${scene.name} · FringeSLAM`;
  const thinned = scene.drawn_triangles < scene.triangles ? `, of which ${scene.drawn_triangles} are drawn` : '';
  byId('about').textContent = `seed ${scene.seed}, ${scene.objects.length} objects, ${scene.triangles} triangles${thinned}`;
  byId('status').textContent = scene.notes.join(' ');
  const world = new World(scene);
  listObjects(scene, world);
  const sensor = new SensorPanel();
  connectSlider(scene, world, sensor);
  sensor.use(scene);
  await world.load((number) => ask(`/mesh/${number}`));
}

// A failure is shown in the page; the rest of it stays usable.
drawPage(() => {
  readToken();
  showScene().catch((error) => {
    byId('failure').textContent = `The scene could not be loaded: ${error.message}`;
    byId('failure').hidden = false;
  });
});
