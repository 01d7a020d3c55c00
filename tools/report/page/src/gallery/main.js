// SPDX-License-Identifier: Apache-2.0
// The scenes of a folder: their pictures, a button that opens each, and a place to drop a mesh that becomes a scene.
import {byId, element} from '../shared/dom.js';
import {drawPage} from '../shared/page.js';
import {keepPolling, pause, reason} from '../shared/polling.js';
import {ask, order, readToken, send} from '../live/server.js';

const kLookMs = 1000;  // between looks for pictures that are not drawn yet
const kUploadMs = 60000;

// The program's own message.
class Failed extends Error {}
const textOf = (error) => (error instanceof Failed ? error.message : reason(error));

class Gallery {
  constructor() {
    this.cards = new Map();  // by name: {item, picture, state, button, text}
    this.missing = new Set();  // names of the scenes whose picture is not shown yet
    byId('filter').addEventListener('input', () => this.filter());
    const drop = byId('drop'), input = byId('mesh');
    input.addEventListener('change', () => input.files[0] && this.create(input.files[0]).finally(() => (input.value = '')));
    for (const kind of ['dragenter', 'dragover']) {
      drop.addEventListener(kind, (event) => {
        event.preventDefault();
        drop.classList.add('over');
      });
    }
    drop.addEventListener('dragleave', () => drop.classList.remove('over'));
    drop.addEventListener('drop', (event) => {
      event.preventDefault();
      drop.classList.remove('over');
      if (event.dataTransfer.files[0]) this.create(event.dataTransfer.files[0]);
    });
  }

  async list() {
    const {folder, scenes} = await (await ask('/scenes')).json();
    byId('name').textContent = 'Scenes';
    byId('about').textContent = folder;
    byId('status').textContent = '';
    for (const scene of scenes) if (!this.cards.has(scene.name)) this.add(scene);
    byId('scenes').replaceChildren(...scenes.map(({name}) => this.cards.get(name).item));
    this.filter();
  }

  add({name, description, command}) {
    const picture = element('img', {class: 'thumbnail', alt: '', 'data-state': 'waiting'});
    const state = element('p', {class: 'failed', role: 'alert', hidden: true});
    const button = element('button', {type: 'button', class: 'button', title: command, onclick: () => this.open(name)}, 'Open');
    const item = element('li', {'data-scene': name}, picture,
      element('div', {class: 'about'}, element('h3', {}, name), element('p', {}, description), state, button));
    this.cards.set(name, {item, picture, state, button, text: `${name} ${description}`.toLowerCase()});
    this.missing.add(name);
  }

  filter() {
    const wanted = byId('filter').value.trim().toLowerCase();
    let shown = 0;
    for (const {item, text} of this.cards.values()) {
      item.hidden = !text.includes(wanted);
      shown += !item.hidden;
    }
    byId('count').textContent = `${shown} of ${this.cards.size}`;
  }

  // Fetches the pictures that are drawn by now.
  async poll() {
    if (this.cards.size === 0) await this.list();
    for (const name of [...this.missing]) {
      const {picture} = this.cards.get(name);
      const answer = await ask(`/picture/${encodeURIComponent(name)}.png`);
      if (!answer) break;  // they are drawn in this order
      const drawn = answer.headers.get('Content-Type') === 'image/png';
      if (drawn) {
        picture.src = URL.createObjectURL(await answer.blob());
        await picture.decode();
      }
      picture.dataset.state = drawn ? 'drawn' : 'failed';
      this.missing.delete(name);
    }
    await pause(kLookMs);
  }

  // Opens the page of a scene, once the scene is loaded.
  async open(name) {
    const {button, state} = this.cards.get(name);
    const say = (error) => {
      state.textContent = error;
      state.hidden = !error;
    };
    button.disabled = true;
    button.textContent = 'Loading';
    say('');
    try {
      await order(`/open?${new URLSearchParams({scene: name})}`);
      for (;;) {
        const answer = await ask(`/opened?${new URLSearchParams({scene: name})}`);
        if (!answer) throw new Failed('closed, because other scenes were opened');
        const {url, error} = await answer.json();
        if (error) throw new Failed(error);
        if (!url) continue;
        const there = new URL(url);
        there.hostname = location.hostname;
        location.assign(there);
        break;
      }
    } catch (error) {
      say(textOf(error));
    }
    button.disabled = false;
    button.textContent = 'Open';
  }

  async create(file) {
    const state = byId('mesh-state');
    state.textContent = `Reading ${file.name}`;
    try {
      const query = new URLSearchParams({file: file.name});
      const {name, error} = await (await send('POST', `/mesh?${query}`, AbortSignal.timeout(kUploadMs), file)).json();
      if (error) throw new Failed(error);
      state.textContent = `Created ${name}`;
      await this.list();
      byId('filter').value = '';
      this.filter();
      this.cards.get(name).item.scrollIntoView({block: 'center'});
      this.cards.get(name).button.focus();
    } catch (error) {
      state.textContent = textOf(error);
    }
  }
}

drawPage(() => {
  readToken();
  const gallery = new Gallery();
  keepPolling(() => gallery.poll(), (error) => (byId('status').textContent = reason(error)));
});
