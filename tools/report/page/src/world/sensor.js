// SPDX-License-Identifier: Apache-2.0
// Shows the camera view from the chosen place of the path: a reduced picture first, then the full one.
import {colourBar} from '../shared/colour_bar.js';
import {byId, choice, element} from '../shared/dom.js';
import {fixed} from '../shared/format.js';
import {LevelPicture} from '../shared/level_picture.js';
import {pause} from '../shared/polling.js';
import {ask, Refused} from '../live/server.js';

const kPatienceMs = 300;  // before a busy server is asked again
const kLights = ['lit', 'in shadow', 'outside the beam'];  // by level
const kKinds = {
  texture: 'Texture', pattern: 'Pattern', depth: 'Depth', mask: 'Shadow and beam', wrong_order: 'Wrong-order risk',
  indirect: 'Indirect light', temperature: 'Temperature',
};
const kUnknown = {wrong_order: 'no fringe order', indirect: 'no light of the projector'};
const kLeastPower = -6;  // of ten: smaller probabilities of a wrong order look alike
const kNotes = {
  texture: 'White projector light and ambient light. White: full scale of the camera.', pattern: 'White: full scale of the camera.',
};
const kDescriptions = {
  texture: 'Camera image under white projector light', pattern: 'Camera image under a pattern',
  depth: 'Depth, near is dark', mask: 'Surfaces that are lit, in shadow or outside the beam',
  wrong_order: 'Probability of a wrong fringe order', indirect: 'Share of light that arrives by other surfaces',
  temperature: 'Temperature of the surfaces',
};

export class SensorPanel {
  constructor() {
    this.scene = null;
    this.wanted = {place: 0, kind: 'texture', pattern: 0};
    this.version = 0;  // of what is wanted
    this.request = null;  // in progress: {controller, size}
    this.running = false;
    this.waiting = [];  // for the next picture
    this.onWant = () => {};  // called when something else is wanted

    this.image = element('img', {alt: ''});
    const palettes = {depth: 'viridis', mask: 'lights', wrong_order: 'cividis', indirect: 'cividis', temperature: 'cividis'};
    this.levels = Object.fromEntries(Object.entries(palettes).map(
      ([kind, palette]) => [kind, new LevelPicture(element('canvas', {role: 'img', hidden: true}), palette)]));
    this.frame = element('div', {class: 'frame', id: 'sensor-picture'}, this.image, ...Object.values(this.levels).map(({canvas}) => canvas));
    this.state = element('span', {class: 'value', id: 'sensor-state', role: 'status'});
    this.below = element('div', {class: 'colour-key'});
    this.kind = element('span');
    this.pattern = element('span', {hidden: true});
    byId('sensor').append(
      element('div', {class: 'controls'}, this.kind, this.pattern),
      element('figure', {class: 'card'}, element('figcaption', {}, element('h3', {}, 'Camera'), this.state), this.frame, this.below));
    const texts = {
      depth: (share) => `${{0: 'below ', 1: 'above '}[share] ?? ''}${this.metres(share)}`,
      mask: (share) => kLights[Math.round(2 * share)],
      wrong_order: (share) => this.risk(share),
      indirect: (share) => `${fixed(100 * share, 0)} %`,
      temperature: (share) => this.degrees(share),
    };
    for (const [kind, picture] of Object.entries(this.levels)) {
      picture.onPointer((share) => this.say(Number.isFinite(share) ? texts[kind](share) : share));
    }
  }

  // Returns the depth at a share of the rig's range.
  metres(share, digits = 3) {
    const {near_m: near, far_m: far} = this.scene.rig;
    return `${fixed(near + share * (far - near), digits)} m`;
  }

  degrees(share) {
    const [low, high] = this.scene.temperature_c;
    return `${fixed(low + share * (high - low), 1)} °C`;
  }

  risk(share) {
    return `${share === 0 ? 'below ' : ''}${(10 ** (kLeastPower * (1 - share))).toPrecision(1)}`;
  }

  // Shows the scene's views from now on; full-size ones only once the world is drawn, so that they do not delay it. Returns
  // once the first picture is shown, or cannot be.
  use(scene, worldDrawn) {
    Object.assign(this, {scene, worldDrawn});
    const {width_px: width, height_px: height} = scene.rig;
    this.frame.style.aspectRatio = `${width} / ${height}`;
    const kind = scene.pictures.includes(this.wanted.kind) ? this.wanted.kind : 'texture';
    this.kind.replaceChildren(choice('Show', scene.pictures.map((name) => [name, kKinds[name]]), (chosen) => this.want({kind: chosen})));
    Object.assign(this.kind.querySelector('select'), {id: 'sensor-kind', value: kind});
    const pattern = Math.min(this.wanted.pattern, scene.patterns.length - 1);
    const select = choice('Pattern', scene.patterns.map((text, i) => [i, `${i}: ${text}`]), (chosen) => this.want({pattern: Number(chosen)}));
    select.querySelector('select').id = 'sensor-pattern';
    select.querySelector('select').value = pattern;
    this.pattern.replaceChildren(select);
    this.want({kind, pattern, place: Math.min(this.wanted.place, scene.path.length - 1)}, true);
    return new Promise((done) => this.waiting.push(done));
  }

  // Returns once the next picture is shown, if the place is another one.
  at(place) {
    if (place === this.wanted.place) return Promise.resolve();
    this.want({place});
    return new Promise((done) => this.waiting.push(done));
  }

  // A reduced picture that was begun is shown even if the place has changed, so that pictures appear while the slider
  // is dragged; everything else that is no longer wanted is cancelled.
  want(changes, all = !('place' in changes)) {
    Object.assign(this.wanted, changes);
    ++this.version;
    this.onWant();
    this.pattern.hidden = this.wanted.kind !== 'pattern';
    if (all || this.request?.size === 'full') this.request?.controller.abort();
    if (this.scene && !this.running) this.run();
  }

  async run() {
    this.running = true;
    for (let reduced = -1, full = -1; full !== this.version;) {
      const version = this.version;
      try {
        if (reduced === version) await Promise.race([this.worldDrawn, new Promise((done) => (this.onWant = done))]);
        if (version !== this.version) continue;
        const rendered = await this.fetch(reduced === version ? 'full' : 'reduced');
        if (version !== this.version) continue;
        if (!rendered) break;  // a newer scene follows
        if (reduced === version) full = version;
        reduced = version;
      } catch (error) {
        if (error.name === 'AbortError') continue;
        if (error instanceof Refused && error.status === 503) {
          await pause(kPatienceMs);
          continue;
        }
        if (version !== this.version) continue;
        this.size = null;
        this.frame.removeAttribute('data-shown');
        this.say(`not rendered: ${error.message}`);
        break;
      }
    }
    this.running = false;
    for (const done of this.waiting.splice(0)) done();
  }

  async fetch(size) {
    const {place, kind, pattern} = this.wanted;
    const {number} = this.scene;
    const controller = new AbortController();
    this.request = {controller, size};
    try {
      const query = new URLSearchParams({scene: number, place, size, ...(kind === 'pattern' && {pattern})});
      const answer = await ask(`/view/${kind}.png?${query}`, controller.signal);
      if (!answer) return false;
      const url = URL.createObjectURL(await answer.blob());
      try {
        await this.show(kind, url);
      } finally {
        URL.revokeObjectURL(url);
      }
    } finally {
      this.request = null;
    }
    this.size = size;
    this.frame.dataset.scene = number;
    this.frame.dataset.shown = `${kind} ${kind === 'pattern' ? `${pattern} ` : ''}${place} ${size}`;
    this.say();
    for (const done of this.waiting.splice(0)) done();
    return true;
  }

  async show(kind, url) {
    const levels = this.levels[kind];
    if (levels) {
      await levels.show(url);
      levels.canvas.setAttribute('aria-label', kDescriptions[kind]);
    } else {
      const image = element('img', {alt: kDescriptions[kind], src: url});
      await image.decode();
      this.image.replaceWith(image);
      this.image = image;
    }
    for (const node of this.frame.children) node.hidden = node !== (levels?.canvas ?? this.image);
    this.below.replaceChildren(...this.key(kind));
  }

  // Returns the legend of a picture.
  key(kind) {
    if (kind === 'depth') return [colourBar('viridis', ...[0, 0.5, 1].map((share) => this.metres(share, 2)))];
    const bar = {
      wrong_order: (share) => this.risk(share), indirect: (share) => `${fixed(100 * share, 0)} %`, temperature: (share) => this.degrees(share),
    }[kind];
    if (bar) return [colourBar('cividis', ...[0, 0.5, 1].map(bar))];
    if (kind === 'mask') return kLights.map((text, i) => element('span', {class: 'entry'}, element('i', {class: `light light-${i}`}), text));
    return [element('span', {class: 'quiet'}, kNotes[kind])];
  }

  // Shows a value, null if there is none here, or by default the size of the picture.
  say(text = this.wanted.kind === 'wrong_order' ? 'a sample of the pixels' : this.size === 'reduced' ? 'reduced; full size follows' : 'full size') {
    this.state.textContent = text ?? (kUnknown[this.wanted.kind] ?? 'no surface');
  }
}
