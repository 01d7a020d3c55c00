// SPDX-License-Identifier: Apache-2.0
// Scatter plot of trials over two quantities, marked by outcome; a trial is chosen by pointer, keys or number.
import {decadesAround, linear, logarithmic} from '../shared/axes.js';
import {axisBelow, axisLeft, label, picture} from '../shared/chart.js';
import {data} from '../shared/data.js';
import {byId, element, svg} from '../shared/dom.js';
import {markIcon} from './causes.js';
import {scaleOf, valueTick} from './parameters.js';
import {ranked} from './sensitivity.js';
import {isPickedOut, placeOf, store, trialAt} from './store.js';
import {trialCard} from './trial_card.js';
import {causeName, outcomeOf, outcomes} from './words.js';

const kLeft = 58;
const kRight = 14;
const kTop = 24;
const kBelow = 44;
const kReachPx = 18;

const all = data.trials.trial.map((_, place) => trialAt(place));

function errorQuantity(name, key) {
  const reach = decadesAround(all.map((trial) => trial[key]));
  return reach && {name, of: (trial) => trial[key], scale: (to) => logarithmic(reach, to)};
}

// A quantity for an axis: {name, of(trial), scale(to), parameter}.
const quantities = [
  ...data.parameters.map((parameter, p) => ({
    name: parameter.name,
    parameter,
    of: (trial) => trial.values[p],
    scale: (to) => scaleOf(parameter, to),
  })),
  errorQuantity('translation error, mm', 'translation_mm'),
  errorQuantity('rotation error, °', 'rotation_deg'),
].filter(Boolean);

// Returns the two most important parameters; if there is only one, its errors.
function firstAxes() {
  const [first, second] = ranked('of_success').map(({name}) => quantities.findIndex((quantity) => quantity.name === name));
  return {x: first, y: second ?? Math.min(1, quantities.length - 1)};
}

const shown = firstAxes();

// Returns null for a trial without a value. Trials with the same choice are spread by their trial number.
function pixelOf(trial, quantity, scale) {
  const value = quantity.of(trial);
  if (value === null || value === undefined || value < 0 && quantity.parameter?.values.length) return null;
  const spread = scale.width ? (((trial.trial * 0.618034) % 1) - 0.5) * 0.7 * scale.width : 0;
  return scale(value) + spread;
}

function marks(places, radius) {
  const front = [];
  const back = [];
  for (const outcome of outcomes) {
    const paths = {true: '', false: ''};
    places.forEach((at, i) => {
      if (at && all[i].outcome === outcome) paths[isPickedOut(all[i])] += outcomeOf(outcome).mark(...at.map((v) => Number(v.toFixed(1))), radius);
    });
    if (paths.false) back.push(svg('path', {d: paths.false, class: `mark o-${outcome} pale`}));
    if (paths.true) front.push(svg('path', {d: paths.true, class: `mark o-${outcome}`}));
  }
  return [...back, ...front];
}

function select(title, chosen, change) {
  const options = quantities.map(({name}, i) => element('option', {value: i, selected: i === chosen}, name));
  const node = element('select', {'aria-label': title, onchange: () => change(Number(node.value))}, ...options);
  return element('label', {class: 'choice'}, title, node);
}

function causeSelect() {
  const options = [['', 'all trials'], ['failures', 'failures'], ...data.trials.causes.map((cause) => [cause, causeName(cause)])];
  const node = element('select', {'aria-label': 'highlight', onchange: () => store.pickOut(node.value)},
    ...options.map(([value, text]) => element('option', {value}, text)));
  store.on(({cause}) => (node.value = cause));
  return element('label', {class: 'choice'}, 'highlight', node);
}

function numberInput() {
  const {trial} = data.trials;
  const choose = () => store.choose(placeOf(Number(node.value)) ?? store.place);
  const node = element('input', {type: 'number', 'aria-label': 'trial', min: trial[0], max: trial[trial.length - 1], class: 'number', onchange: choose});
  store.on(({place}) => (node.value = String(trial[place] ?? '')));
  return element('label', {class: 'choice'}, 'trial', node);
}

class Scatter {
  constructor(box) {
    this.box = box;
    this.places = [];
    this.ring = svg('circle', {r: 9, class: 'ring'});
    box.addEventListener('pointerdown', (event) => this.point(event, true));
    box.addEventListener('pointermove', (event) => event.pointerType === 'mouse' && this.point(event, event.buttons > 0));
    box.addEventListener('keydown', (event) => this.press(event));
    new ResizeObserver(() => this.draw()).observe(box);
  }

  draw() {
    const width = Math.floor(this.box.clientWidth);
    if (width < 50) return;
    const height = Math.round(Math.max(280, Math.min(width * 0.7, 520)));
    const {x, y} = {x: quantities[shown.x], y: quantities[shown.y]};
    const sides = [kLeft, width - kRight];
    const across = x.scale(sides);
    const up = y.scale([height - kBelow, kTop]);
    this.places = all.map((trial) => {
      const at = [pixelOf(trial, x, across), pixelOf(trial, y, up)];
      return at.includes(null) ? null : at;
    });
    const text = (quantity, scale) => (quantity.parameter?.values.length ? valueTick(quantity.parameter, {width: scale === up ? 50 : scale.width}) : undefined);
    const radius = all.length > 1500 ? 2 : all.length > 500 ? 2.8 : 3.6;
    this.box.replaceChildren(picture(width, height,
      axisBelow(across, kTop, height - kBelow, {text: text(x, across), title: x.name}),
      axisLeft(up, ...sides, {text: text(y, up), title: y.name, count: 6}),
      ...marks(this.places, radius), this.ring));
    this.choose();
  }

  choose() {
    const at = this.places[store.place];
    this.ring.style.display = at ? '' : 'none';
    if (!at) return;
    this.ring.setAttribute('cx', at[0]);
    this.ring.setAttribute('cy', at[1]);
  }

  // Chooses the nearest highlighted trial; a click reaches further than a hovering pointer.
  point(event, far) {
    const box = this.box.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    let best = -1;
    let least = far ? 4 * kReachPx : kReachPx / 2;
    this.places.forEach((at, i) => {
      const distance = at && isPickedOut(all[i]) ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
      if (distance < least) [best, least] = [i, distance];
    });
    if (best >= 0 && best !== store.place) store.choose(best);
  }

  // Arrow keys choose the next highlighted trial along an axis.
  press(event) {
    const moves = {ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowUp: [1, -1], ArrowDown: [1, 1]};
    const order = (axis) => [...this.places.keys()].filter((i) => this.places[i] && isPickedOut(all[i]))
      .sort((a, b) => this.places[a][axis] - this.places[b][axis] || a - b);
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    if (event.key === 'Home' || event.key === 'End') store.choose(order(0).at(event.key === 'Home' ? 0 : -1) ?? store.place);
    else if (moves[event.key]) {
      const [axis, by] = moves[event.key];
      const line = order(axis);
      const here = line.indexOf(store.place);
      store.choose(here < 0 ? line[0] ?? store.place : line[Math.max(0, Math.min(line.length - 1, here + by))]);
    } else return;
    event.preventDefault();
  }
}

function legend() {
  return element('p', {class: 'legend'}, ...data.trials.outcomes.slice().sort((a, b) => outcomes.indexOf(a) - outcomes.indexOf(b))
    .map((outcome) => element('span', {class: 'key-entry'}, markIcon(outcome), outcomeOf(outcome).name)));
}

export function showScatter() {
  if (all.length === 0) {
    byId('trials').textContent = 'There are no trials yet.';
    return;
  }
  const box = element('div', {id: 'points', class: 'points', tabindex: '0', role: 'application', 'aria-label': 'Trials', 'aria-describedby': 'points-help'});
  const scatter = new Scatter(box);
  const redraw = (axis) => (chosen) => {
    shown[axis] = chosen;
    scatter.draw();
  };
  byId('trials').append(
    element('div', {class: 'card'},
      element('div', {class: 'controls', role: 'group', 'aria-label': 'Scatter plot display'},
        select('x axis', shown.x, redraw('x')), select('y axis', shown.y, redraw('y')), causeSelect(), numberInput()),
      legend(), box,
      element('p', {id: 'points-help', class: 'quiet note'}, 'Point at a trial, or use the keys: ← → for the next one along x, ↑ ↓ for the next one along y, Home and End for the ends.')),
    trialCard());
  let cause = store.cause;
  store.on((state) => {
    if (state.cause !== cause) scatter.draw();
    cause = state.cause;
    scatter.choose();
  });
}
