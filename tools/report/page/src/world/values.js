// SPDX-License-Identifier: Apache-2.0
// The numbers of the scene: each distribution with the value drawn, and sliders that change any number, as --with does.
import {breakable} from '../shared/chart.js';
import {byId, element} from '../shared/dom.js';
import {plural} from '../shared/format.js';
import {shortPlace} from './places.js';
import {reason} from '../shared/polling.js';
import {order} from '../live/server.js';

const kMostListed = 60;
const kSteps = 200;  // of a slider
const kRestMs = 120;  // without a movement, before a value is ordered

const short = (value) => String(Number(value.toPrecision(5)));

// Bounds of a slider: those of the distribution, else around the value, both within what the scene permits.
function bounds({text, distribution, low, high, whole}) {
  const value = Number(text);
  const [kind, numbers] = [distribution.match(/\w+/)?.[0], (distribution.match(/-?[\d.]+(e[-+]?\d+)?/gi) ?? []).map(Number)];
  let ends;
  if (kind === 'normal') ends = [numbers[0] - 4 * numbers[1], numbers[0] + 4 * numbers[1]];
  else if (numbers.length > 0) ends = [Math.min(...numbers), Math.max(...numbers)];
  else if (value === 0) ends = [-1, 1];
  else ends = value > 0 ? [0, 3 * value] : [3 * value, -value];
  const within = (end) => Math.min(high ?? Infinity, Math.max(low ?? -Infinity, end));
  ends = ends.map(within);
  if (!(ends[1] > ends[0])) ends = [within(value - 1), within(value + 1)];
  return whole ? [Math.floor(ends[0]), Math.ceil(ends[1])] : ends;
}

export class ValuesPanel {
  constructor() {
    this.changes = new Map();
    this.timers = new Map();  // by path
    this.shown = '';  // paths listed
    byId('values-reset').addEventListener('click', () => this.reset());
    this.filter = byId('values-filter');
    this.filter.addEventListener('input', () => this.list());
  }

  use({values}) {
    this.values = values;
    this.list();
  }

  // Changes are ordered ones, [[path, value], …].
  showChanges(changes) {
    this.changes = new Map(changes);
    byId('values-reset').hidden = this.changes.size === 0;
    for (const row of byId('values-list').children) row.classList.toggle('changed', this.changes.has(row.dataset.path));
  }

  list() {
    const words = this.filter.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
    const wanted = this.values.filter(({path, distribution}) =>
      words.length ? words.every((word) => path.toLowerCase().includes(word)) : distribution || this.changes.has(path));
    const drawn = this.values.filter(({distribution}) => distribution).length;
    byId('values-about').textContent = `${plural(this.values.length, 'number')}, ${drawn === 0 ? 'none' : drawn} drawn from ${drawn === 1 ? 'a distribution' : 'distributions'}.`;
    byId('values-more').textContent = wanted.length > kMostListed ? `and ${wanted.length - kMostListed} more; filter them` : '';
    const listed = wanted.slice(0, kMostListed), paths = listed.map(({path}) => path).join('\n');
    const rows = byId('values-list');
    // Rows stay while a slider is moved.
    if (paths === this.shown) listed.forEach((value, i) => rows.children[i].update(value));
    else rows.replaceChildren(...listed.map((value) => this.row(value)));
    this.shown = paths;
    this.showChanges([...this.changes]);
  }

  row(value) {
    const text = element('span', {class: 'value-text'});
    const about = element('small', {});
    const row = element('li', {class: 'value-row', 'data-path': value.path},
      element('span', {class: 'value-name'}, ...breakable(value.path)), text, about);
    let slider, box;
    if (value.changeable && value.number) {
      slider = element('input', {type: 'range', 'aria-label': value.path});
      box = element('input', {type: 'number', class: 'number', step: 'any', 'aria-label': `${value.path}, value`});
      slider.addEventListener('input', () => this.change(value.path, (box.value = slider.value)));
      box.addEventListener('change', () => box.value !== '' && this.change(value.path, box.value));
      const undo = element('button', {type: 'button', class: 'button undo', 'aria-label': `Undo the change of ${value.path}`, onclick: () => this.change(value.path, '')}, 'Undo');
      text.append(box);
      row.append(slider, undo);
    }
    row.update = (now) => {
      about.textContent = [now.distribution && `from ${now.distribution}`, shortPlace(now.place), !now.changeable && 'can be changed in its file only'].filter(Boolean).join(' · ');
      if (!box) return (text.textContent = now.text);
      if (document.activeElement === slider || document.activeElement === box) return undefined;
      const [low, high] = bounds(now);
      Object.assign(slider, {min: short(low), max: short(high), step: now.whole ? 1 : short((high - low) / kSteps)});
      slider.value = now.text;
      box.value = now.text;
      return undefined;
    };
    row.update(value);
    return row;
  }

  // The new scene arrives by polling.
  change(path, value) {
    clearTimeout(this.timers.get(path));
    this.timers.set(path, setTimeout(async () => {
      try {
        await order(`/value?${new URLSearchParams({path, ...(value !== '' && {value})})}`);
      } catch (error) {
        byId('status').textContent = reason(error);
      }
    }, kRestMs));
  }

  reset() {
    for (const path of this.changes.keys()) this.change(path, '');
  }
}
