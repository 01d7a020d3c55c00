// SPDX-License-Identifier: Apache-2.0
// A scene while its author edits it: its world in 3D, the rig along its path, what the camera sees, and the objects. The
// server reports each new version of the scene, and errors in its files.
import {commandLine} from '../shared/copy.js';
import {byId, element} from '../shared/dom.js';
import {fixed} from '../shared/format.js';
import {drawPage} from '../shared/page.js';
import {keepPolling, pause, reason} from '../shared/polling.js';
import {ask, order, readToken} from '../live/server.js';
import {DifficultyPanel} from './difficulty.js';
import {SensorPanel} from './sensor.js';
import {shortPlace} from './places.js';
import {ValuesPanel} from './values.js';
import {World} from './world.js';

const kMostListed = 500;
const kLongestLagMs = 100;  // of the rig in the world behind the slider

// Returns after the next frame of the page.
const nextFrame = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));

class ScenePage {
  constructor() {
    this.world = new World();
    this.sensor = new SensorPanel();
    this.difficulty = new DifficultyPanel((time_s) => this.goTo(time_s), (levels, views) => this.world.colourPath(levels, views));
    this.values = new ValuesPanel();
    this.scene = null;
    this.drawn = null;  // number of the scene whose world is drawn
    this.number = null;  // of the state shown
    byId('time').addEventListener('input', () => this.showTime());
    byId('new-seed').addEventListener('click', () => this.drawSeed());
    this.world.onSelect = () => {
      this.showSelected();
      this.buttons[this.world.selected]?.scrollIntoView({block: 'nearest'});
    };
    this.world.onPlace = (place, position) => this.place(place, position);
    byId('move').addEventListener('submit', (event) => {
      event.preventDefault();
      const place = this.world.place();
      if (!place) return;
      this.noteCoordinates(place);
      this.place(place, this.coordinates.map((box) => Number(box.value)));
    });
    this.coordinates = [...byId('move').querySelectorAll('input')];
  }

  async poll() {
    const answer = await ask(this.number === null ? '/state' : `/state?since=${this.number}`);
    const state = await answer.json();
    if (state.scene !== this.drawn && !(await this.load(state.scene))) return;
    this.number = state.number;
    byId('scene-error').hidden = !state.error;
    if (byId('scene-error').textContent !== state.error) byId('scene-error').textContent = state.error;
    byId('status').textContent = state.loading ? 'Loading the changed scene' : this.scene.notes.join(' ');
    if (this.command !== state.command) this.showCommand(state.command);
    this.values.showChanges(state.changes);
    byId('new-seed').disabled = state.loading;
  }

  // Shows a version of the scene; returns false if there is a newer one already.
  async load(number) {
    const answer = await ask(`/scene/${number}`);
    if (!answer) return false;
    const scene = {...await answer.json(), number};
    this.scene = scene;
    byId('name').textContent = scene.name;
    document.title = `${scene.name} · FringeSLAM`;
    const thinned = scene.drawn_triangles < scene.triangles ? `, of which ${scene.drawn_triangles} are drawn` : '';
    byId('about').textContent = `seed ${scene.seed}, ${scene.objects.length} objects, ${scene.triangles} triangles${thinned}`;
    this.listObjects();
    this.values.use(scene);
    byId('time').max = scene.path.length - 1;
    const shown = this.world.show(scene, (mesh) => ask(`/mesh/${mesh}`), (tile) => ask(`/tile/${tile}`));
    const drawn = shown.catch(() => {}).then(nextFrame);
    const pictured = this.sensor.use(scene, drawn);  // a reduced picture needs no meshes
    if (!(await shown)) return false;
    this.drawn = number;
    this.showSelected();
    this.showTime();
    // Assessing the difficulty takes all processors, so it starts when there is something to see.
    Promise.all([pictured, drawn]).then(() => this.scene === scene && this.difficulty.use(scene));
    return true;
  }

  // Shows the command that opens this variant of the scene.
  showCommand(text) {
    this.command = text;
    byId('command').replaceChildren(commandLine(text, 'this scene'));
  }

  // The new scene arrives by polling.
  async drawSeed() {
    try {
      await order('/seed');
    } catch (error) {
      byId('status').textContent = reason(error);
    }
  }

  // Moves the slider to the place nearest in time.
  goTo(time_s) {
    const {path} = this.scene;
    byId('time').value = path.reduce((best, {time_s: at}, i) => (Math.abs(at - time_s) < Math.abs(path[best].time_s - time_s) ? i : best), 0);
    this.showTime();
  }

  showTime() {
    if (!this.scene) return;
    const slider = byId('time'), index = Number(slider.value);
    const text = this.scene.continuous ? `${fixed(this.scene.path[index].time_s, 2)} s` : `view ${index}`;
    byId('time-text').textContent = text;
    slider.setAttribute('aria-valuetext', text);
    this.difficulty.at(this.scene.path[index].time_s);
    const pictured = this.sensor.at(index);
    // The camera's picture comes first: without a GPU, drawing the world takes longer.
    Promise.race([pictured, pause(kLongestLagMs)]).then(nextFrame).then(() => {
      if (Number(slider.value) === index) this.world.showRig(this.scene.path[index]);
    });
  }

  listObjects() {
    const {objects} = this.scene;
    this.buttons = objects.slice(0, kMostListed).map((object, i) =>
      element('button', {type: 'button', class: 'button', 'aria-pressed': 'false', onclick: () => this.world.select(i)}, `${object.name}: ${object.material}`));
    const list = byId('object-list'), {scrollTop} = list;
    list.replaceChildren(...this.buttons.map((button) => element('li', {}, button)));
    list.scrollTop = scrollTop;
    byId('more').textContent = objects.length > kMostListed ? `and ${objects.length - kMostListed} more; click them in the world` : '';
  }

  // Shows the selected object or waypoint.
  showSelected() {
    const {world} = this, place = world.place(), object = this.scene.objects[world.selected];
    this.buttons.forEach((button, k) => button.setAttribute('aria-pressed', String(k === world.selected)));
    byId('move').hidden = !place;
    if (place && !this.isTyping(place)) {
      this.coordinates.forEach((box, axis) => (box.value = Number(place.position[axis].toFixed(4))));
      this.noteCoordinates(place);
    }
    const numbers = (list) => list.map((value) => fixed(value, 3)).join(', ');
    let facts = [];
    if (object) {
      facts = [['name', object.name], ['line', shortPlace(object.place)], ['material', object.material], ['position', `${numbers(object.pose.slice(0, 3))} m`],
        ['quaternion x y z w', numbers(object.pose.slice(3))]];
    } else if (place) {
      facts = [['waypoint', place.name], ['position', `${numbers(place.position)} m`]];
    }
    byId('selected').replaceChildren(...facts.flatMap(([name, value]) => [element('dt', {}, name), element('dd', {}, value)]));
  }

  noteCoordinates({path}) {
    this.noted = {path, texts: this.coordinates.map((box) => box.value)};
  }

  // True while coordinates of this place are being typed, which a new version of the scene must not replace.
  isTyping({path}) {
    return path === this.noted?.path && byId('move').contains(document.activeElement) &&
      this.coordinates.some((box, axis) => box.value !== this.noted.texts[axis]);
  }

  // Stores a position in placed.yaml; the changed scene arrives by polling.
  async place({path, offset = [0, 0, 0]}, position) {
    const [x, y, z] = position.map((value, axis) => value + offset[axis]);
    let error;
    try {
      ({error} = await (await order(`/place?${new URLSearchParams({path, x, y, z})}`)).json());
    } catch (failure) {
      error = reason(failure);
    }
    byId('place-error').textContent = error;
    byId('place-error').hidden = !error;
    if (error) this.world.markSelected();
  }
}

drawPage(() => {
  readToken();
  const page = new ScenePage();
  keepPolling(() => page.poll(), (error) => (byId('status').textContent = reason(error)));
});
