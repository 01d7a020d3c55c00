// SPDX-License-Identifier: Apache-2.0
// Pictures of the chosen view: texture with landmarks, depth, depth error, and its tracking state.
import {colourBar} from '../shared/colour_bar.js';
import {data} from '../shared/data.js';
import {byId, checkbox, element, svg} from '../shared/dom.js';
import {fixed, short} from '../shared/format.js';
import {LevelPicture} from '../shared/level_picture.js';
import {stateCard} from './state_card.js';
import {store} from './store.js';

const {near_m: near, far_m: far, error_limit_mm: limit, cold_c: cold, warm_c: warm, every} = data.pictures;

// Returns the view whose pictures are shown for a view: itself or, if it has none, the previous one that has some.
export function pictured(place) {
  return data.views[place - (place % every)];
}

function card(title, ...content) {
  const value = element('span', {class: 'value', 'aria-hidden': 'true'});
  const node = element('figure', {class: 'card'}, element('figcaption', {}, element('h3', {}, title), value), ...content);
  return {node, value};
}

function textureCard() {
  const image = element('img', {alt: '', width: data.rig.width_px, height: data.rig.height_px});
  const outlines = svg('svg', {class: 'outlines', viewBox: `-0.5 -0.5 ${data.rig.width_px} ${data.rig.height_px}`, 'aria-hidden': 'true'});
  const frame = element('div', {class: 'frame'}, image, outlines);
  const {node, value} = card('Texture', frame);
  const toggle = checkbox('landmarks', true, (on) => outlines.classList.toggle('hidden', !on));
  const key = element('span', {class: 'key quiet'}, element('i', {class: 'known'}), 're-identified ', element('i', {class: 'new'}), 'new');
  node.append(element('div', {class: 'below'}, toggle, key));
  return {
    node,
    show(view) {
      image.src = view.pictures.texture;
      image.alt = `Camera image of view ${view.index}, without fringes`;
      const landmarks = view.landmarks ?? [];
      outlines.replaceChildren(
        ...landmarks.map(({outline, recognised}) =>
          svg('polygon', {points: outline.join(' '), class: recognised ? 'known' : 'new'})),
      );
      value.textContent = landmarks.length ? `${landmarks.length} landmarks` : '';
    },
  };
}

function levelCard(title, key, palette, ends, text, description, nothing = 'no depth') {
  const canvas = element('canvas', {role: 'img', width: data.rig.width_px, height: data.rig.height_px});
  const picture = new LevelPicture(canvas, palette);
  const {node, value} = card(title, element('div', {class: 'frame'}, canvas), colourBar(palette, ...ends));
  picture.onPointer((share) => (value.textContent = share === undefined ? '' : share === null ? nothing : text(share)));
  return {
    node,
    show(view) {
      canvas.setAttribute('aria-label', `${description} of view ${view.index}, ${ends[0]} to ${ends[2]}`);
      return picture.show(view.pictures[key]);
    },
  };
}

function depthCard() {
  const metres = (share) => near + share * (far - near);
  const ends = [0, 0.5, 1].map((share) => `${fixed(metres(share), 2)} m`);
  return levelCard('Depth', 'depth', 'viridis', ends, (share) => `${fixed(metres(share), 3)} m`, 'Depth');
}

function errorCard() {
  const ends = [`−${short(limit)} mm`, '0', `+${short(limit)} mm`];
  const text = (share) => {
    if (share === 0) return `below ${ends[0]}`;
    if (share === 1) return `above ${ends[2]}`;
    return `${fixed((2 * share - 1) * limit, Math.max(0, 3 - Math.ceil(Math.log10(limit))))} mm`;
  };
  return levelCard('Depth error', 'error', 'diverging', ends, text, 'Depth error');
}

function temperatureCard() {
  const degrees = (share) => cold + share * (warm - cold);
  const ends = [0, 0.5, 1].map((share) => `${fixed(degrees(share), 0)} °C`);
  const text = (share) => (share === 1 ? `above ${ends[2]}` : `${fixed(degrees(share), 1)} °C`);
  return levelCard('Temperature', 'temperature', 'cividis', ends, text, 'Temperature', 'not seen');
}

export function showPictures() {
  const place = byId('pictures');
  const state = stateCard();
  const cards = [textureCard(), depthCard()];
  if (data.has_truth) cards.push(errorCard());
  if (data.views.some((view) => view.pictures?.temperature)) cards.push(temperatureCard());
  const borrowed = element('p', {class: 'quiet borrowed', hidden: true});
  place.append(borrowed, ...cards.map(({node}) => node), state.node);
  store.onView((chosen) => {
    const view = pictured(chosen);
    const own = view === data.views[chosen];
    borrowed.hidden = own;
    borrowed.textContent = own ? '' : `Pictures of view ${view.index}; those of view ${data.views[chosen].index} are not in this page.`;
    for (const {show} of cards) show(view);
    state.show(data.views[chosen]);
  });
}
