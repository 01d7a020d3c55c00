// SPDX-License-Identifier: Apache-2.0
// Pictures of the newest view, always all of the same view; the next ones are requested when these are shown.
import {colourBar} from '../shared/colour_bar.js';
import {byId, checkbox, element, svg} from '../shared/dom.js';
import {fixed} from '../shared/format.js';
import {LevelPicture} from '../shared/level_picture.js';
import {ask} from './server.js';
import {on, store} from './store.js';

const kLeastMs = 150;  // minimum between views

function card(title, note, ...content) {
  const value = element('span', {class: 'value'}, note);
  return {node: element('figure', {class: 'card'}, element('figcaption', {}, element('h3', {}, title), value), ...content), value};
}

function sized(...nodes) {
  const {width_px: width, height_px: height} = store.about.rig;
  for (const node of nodes) {
    node.setAttribute('width', width);
    node.setAttribute('height', height);
  }
}

// Decodes a picture for display.
async function fetched(path) {
  const answer = await ask(path);
  if (!answer) return null;
  const url = URL.createObjectURL(await answer.blob());
  const image = new Image();
  image.src = url;
  try {
    await image.decode();
  } catch (error) {
    URL.revokeObjectURL(url);
    throw error;
  }
  return {image, url};
}

// Fetches pictures of the same view; returns null if one of them is gone.
async function allFetched(paths) {
  const results = await Promise.allSettled(paths.map(fetched));
  const pictures = results.map(({value}) => value);
  if (pictures.every(Boolean)) return pictures;
  for (const picture of pictures) if (picture) URL.revokeObjectURL(picture.url);
  const failed = results.find(({status}) => status === 'rejected');
  if (failed) throw failed.reason;
  return null;
}

function plainCard(name, title, note, description) {
  const frame = element('div', {class: 'frame'});
  const {node, value} = card(title, note, frame);
  return {
    name, node, value, frame,
    show({image, url}, {index}) {
      URL.revokeObjectURL(url);
      image.alt = `${description} of view ${index}`;
      sized(image);
      frame.querySelector('img')?.remove();
      frame.prepend(image);
    },
  };
}

function textureCard() {
  const result = plainCard('texture.jpg', 'Texture', 'without fringes', 'Camera image without fringes');
  const outlines = svg('svg', {class: 'outlines', 'aria-hidden': 'true'});
  result.frame.append(outlines);
  const key = element('div', {class: 'below', hidden: true},
    checkbox('landmarks', true, (on) => outlines.classList.toggle('hidden', !on)),
    element('span', {class: 'key quiet'}, element('i', {class: 'known'}), 're-identified ', element('i', {class: 'new'}), 'new'));
  result.node.append(key);
  const {show} = result;
  result.show = (picture, view) => {
    show(picture, view);
    const {width_px, height_px} = store.about.rig;
    outlines.setAttribute('viewBox', `-0.5 -0.5 ${width_px} ${height_px}`);
    outlines.replaceChildren(...view.landmarks.map(({outline_px, recognised}) =>
      svg('polygon', {points: outline_px.join(' '), class: recognised ? 'known' : 'new'})));
    key.hidden = !store.about.maps;
    result.value.textContent = view.landmarks.length ? `${view.landmarks.length} landmarks` : 'without fringes';
  };
  return result;
}

// Depth levels from 1 (far_m) to 255 (near_m).
function depthCard() {
  const canvas = element('canvas', {role: 'img'});
  const picture = new LevelPicture(canvas, 'viridis');
  const bar = element('div');
  const {node, value} = card('Depth', '', element('div', {class: 'frame'}, canvas), bar);
  const metres = (share) => store.about.rig.far_m - share * (store.about.rig.far_m - store.about.rig.near_m);
  picture.onPointer((share) => (value.textContent = share === undefined ? '' : share === null ? 'no depth' : `${fixed(metres(share), 2)} m`));
  return {
    name: 'depth.png', node,
    async show({url}, {index}) {
      try {
        await picture.show(url);
      } finally {
        URL.revokeObjectURL(url);
      }
      bar.replaceChildren(colourBar('viridis', ...[0, 0.5, 1].map((share) => `${fixed(metres(share), 2)} m`)));
      canvas.setAttribute('aria-label', `Depth of view ${index}, near is bright`);
    },
  };
}

export function showPictures() {
  const light = [
    plainCard('modulation.jpg', 'Modulation', 'white: full-scale fringes', 'Modulation of the fringes'),
    plainCard('saturation.png', 'Saturation', 'brightest sample; red: clipped', 'Brightest sample of each pixel, red where clipped'),
  ];
  const cards = [textureCard(), depthCard(), ...light];
  const shown = () => cards.filter(({node}) => !node.hidden);
  let busy = false, wanted = null;
  const toggle = checkbox('modulation and saturation', false, (on) => {
    for (const {node} of light) node.hidden = !on;
    wanted = null;
    update();
  });
  byId('pictures').append(...cards.map(({node}) => node), element('div', {class: 'whole'}, toggle));
  // While capturing, the light comes first.
  on('restart', () => {
    toggle.querySelector('input').checked = !store.about.maps;
    for (const {node} of light) node.hidden = store.about.maps;
  });

  async function update() {
    const view = store.newest;
    if (busy || !view || wanted === `${store.run} ${view.number}`) return;
    busy = true;
    wanted = `${store.run} ${view.number}`;
    const visible = shown();
    let failed = false;
    try {
      const pictures = await allFetched(visible.map(({name}) => `/picture/${view.number}/${name}`));
      if (pictures) {
        await Promise.all(visible.map((each, i) => each.show(pictures[i], view)));
        byId('pictures').dataset.view = view.number;
      }
      await new Promise((done) => setTimeout(done, kLeastMs));
    } catch {
      failed = true;
      wanted = null;  // the connection reports the error, and the next change asks again
    }
    busy = false;
    if (!failed || store.newest !== view) update();  // there may be a newer view, or other pictures may be wanted
  }
  on('change', update);
}
