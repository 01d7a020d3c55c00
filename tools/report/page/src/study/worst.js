// SPDX-License-Identifier: Apache-2.0
// Pictures of the worst trials, which are run again for them.
import {colourBar} from '../shared/colour_bar.js';
import {commandLine} from '../shared/copy.js';
import {data} from '../shared/data.js';
import {byId, element} from '../shared/dom.js';
import {figure, short} from '../shared/format.js';
import {LevelPicture} from '../shared/level_picture.js';
import {markIcon} from './causes.js';
import {placeOf, store} from './store.js';
import {endOf, facts} from './trial_card.js';

function errorCanvas({width, height, error, index}) {
  const canvas = element('canvas', {role: 'img', width, height, 'aria-label': `Depth error of view ${index}; striped where there is no depth`});
  return {canvas, drawn: new LevelPicture(canvas, 'diverging').show(error)};
}

function viewFigure(view, waits) {
  const {canvas, drawn} = errorCanvas(view);
  waits.push(drawn);
  const texture = element('img', {src: view.texture, width: view.width, height: view.height, alt: `Camera image of view ${view.index}, without fringes`});
  return element('figure', {class: 'view'},
    element('figcaption', {class: 'quiet'}, `View ${view.index}${view.lost ? ' (lost)' : ''}`),
    element('div', {class: 'pair'}, element('div', {class: 'frame'}, texture), element('div', {class: 'frame'}, canvas)));
}

function picturesOf({views, limit_mm: limit, unpictured}, waits) {
  if (!views) return element('p', {class: 'notice unpictured'}, unpictured ?? 'It was not run again for pictures.');
  return element('div', {class: 'views'}, ...views.map((view) => viewFigure(view, waits)),
    element('p', {class: 'quiet note'}, 'Left: camera image; right: depth error; stripes: no depth.'),
    colourBar('diverging', `−${short(limit)} mm`, '0', `+${short(limit)} mm`));
}

function showInScatter(trial) {
  store.choose(placeOf(trial));
  byId('scatter').scrollIntoView({block: 'start'});
  byId('points').focus({preventScroll: true});
}

function card(worst, waits) {
  const {trial, translation_mm: error, message, values, command} = worst;
  const rows = data.parameters.map(({name}, p) => [name, values?.[p] ?? '–']);
  return element('article', {id: `trial-${trial}`, class: 'card worst-card', tabindex: '-1', 'aria-labelledby': `trial-${trial}-name`},
    element('h3', {id: `trial-${trial}-name`}, markIcon(worst.outcome), `Trial ${trial}: ${endOf(worst)}`),
    element('p', {class: 'note quiet'}, error === null ? 'No motion to measure. ' : `Translation error ${figure(error)} mm. `,
      element('button', {type: 'button', class: 'chooser', onclick: () => showInScatter(trial)}, 'Show in the scatter plot')),
    message ? element('p', {class: 'note'}, message) : null,
    picturesOf(worst, waits),
    element('details', {}, element('summary', {}, 'Parameter values'), facts(rows)),
    commandLine(`${command} --out runs/trial-${trial}`, `trial ${trial}`));
}

export async function showWorst() {
  const place = byId('worst-cards');
  if (data.worst.length === 0) {
    place.append(element('p', {}, data.summary.successes < data.summary.trials
      ? 'None was run again for this page; use fringeslam study report --worst N.' : 'No trial failed.'));
    return;
  }
  const waits = [];
  place.before(element('p', {class: 'quiet lead'}, 'First the worst of each cause, then the others. The command runs a trial again and keeps all its files.'));
  place.append(...data.worst.map((worst) => card(worst, waits)));
  await Promise.all(waits);
}
