// SPDX-License-Identifier: Apache-2.0
// How difficult the path is for the mapper: curves over its views, with the limits beyond which a view is expected to
// fail, and why. The server assesses one view after another.
import {decadesAround, linear, logarithmic} from '../shared/axes.js';
import {axisBelow, axisLeft, label, line, path, picture} from '../shared/chart.js';
import {byId, choice, element, svg} from '../shared/dom.js';
import {figure, fixed, plural} from '../shared/format.js';
import {pause} from '../shared/polling.js';
import {ask, Refused} from '../live/server.js';

const kPatienceMs = 1000;  // before a busy server is asked again
const kHeight = 132, kTop = 22, kBelow = 24, kLeft = 46, kRight = 10;
const kClose = 0.5;  // of the limit
const kNames = {range: 'Range', depth: 'Depth', overlap: 'Overlap', motion: 'Motion', repetition: 'Repetition', speed: 'Speed'};

const length = (vector) => vector && Math.hypot(...vector);
// {title, unit, kind: of the limit, value: of a view, digits, share, log}; limit: value at which the strain is 1.
const kCharts = [
  {title: 'Lit and in range', unit: '% of the pixels', kind: 'range', value: (view) => 100 * view.in_range, full: 100},
  {title: 'Measured', unit: '% of the pixels', kind: 'depth', value: (view) => 100 * view.measured, full: 100},
  {title: 'Overlap with the view before', unit: '%', kind: 'overlap', value: (view) => view.overlap === null ? null : 100 * view.overlap, full: 100},
  {title: 'Expected depth σ', unit: 'µm, median', value: (view) => view.sigma_m && 1e6 * view.sigma_m, log: true},
  {title: 'Cramér-Rao bound, position', unit: 'µm', kind: 'motion', value: (view) => view.translation_m && 1e6 * length(view.translation_m), log: true},
  {title: 'Cramér-Rao bound, rotation', unit: 'mrad', kind: 'motion', value: (view) => view.rotation_rad && 1e3 * length(view.rotation_rad), log: true},
  {title: 'Image motion', unit: 'px per image', kind: 'speed', value: (view) => view.step_px},
];

// Levels: 0 easy, 1 close to a limit, 2 beyond it. A strain of null is infinite.
const levelOf = (strain) => (strain === null || strain >= 1 ? 2 : strain >= kClose ? 1 : 0);
export const kLevels = ['easy', 'close', 'beyond'];

// The value at which the strain would be 1, from a view where both are known. Shares are strained when they are small.
function limitOf({value, kind, full}, views) {
  for (const view of views) {
    const [strain, at] = [view.strain[kind], value(view)];
    if (strain > 0 && at > 0 && Number.isFinite(strain)) return full ? strain * at : at / strain;
  }
  return null;
}

export class DifficultyPanel {
  // `choose(time_s)` moves the rig; `colour(levels, views)` colours the path by a level per view.
  constructor(choose, colour) {
    this.choose = choose;
    this.colour = colour;
    this.views = [];
    this.kind = 'worst';
    this.time_s = null;
    const by = choice('path colour', [['worst', 'worst of all'], ...Object.entries(kNames)], (kind) => {
      this.kind = kind;
      this.showPath();
    });
    by.querySelector('select').id = 'path-colour';
    byId('path-options').append(by, element('span', {class: 'levels'}, ...[['easy', 'easy'], ['close', 'near a limit'], ['beyond', 'beyond it']].map(([name, text]) =>
      element('span', {class: 'entry'}, element('i', {class: `level level-${name}`}), text))));
    this.state = byId('difficulty-state');
    this.here = byId('difficulty-here');
    this.list = byId('difficulty-list');
    this.boxes = kCharts.map((chart) => {
      const box = element('div', {class: 'chart', role: 'img'});
      box.addEventListener('click', (event) => this.click(event, box));
      new ResizeObserver(() => this.draw(chart, box)).observe(box);
      byId('difficulty-plots').append(element('figure', {class: 'card'},
        element('figcaption', {}, element('h3', {}, chart.title), element('span', {class: 'value'}, chart.unit)), box));
      return [chart, box];
    });
  }

  // Follows the assessment of a scene from now on.
  async use(scene) {
    if (this.scene?.number === scene.number) return;
    this.scene = scene;
    this.views = [];
    this.total = null;
    this.error = '';
    this.show();
    while (this.scene === scene) {
      try {
        const answer = await ask(`/difficulty?scene=${scene.number}&known=${this.views.length}`);
        if (!answer || this.scene !== scene) return;
        const {total, done, error, views} = await answer.json();
        if (this.scene !== scene) return;
        Object.assign(this, {total, error});
        this.views.push(...views);
        if (views.length || done) this.show(done);
        if (done) return;
      } catch (error) {
        if (error instanceof Refused && error.status !== 503) return;
        await pause(kPatienceMs);
      }
    }
  }

  at(time_s) {
    this.time_s = time_s;
    for (const box of this.boxes) this.mark(...box);
    this.showHere();
  }

  show(done = false) {
    const {views, total} = this;
    const red = views.filter((view) => Object.keys(view.reasons).length > 0).length;
    const progress = done ? `${plural(views.length, 'view')} assessed` : `${views.length} of ${total ?? '…'} views assessed`;
    this.state.textContent = this.error || `${progress}; ${red === 0 ? 'none' : red} beyond a limit`;
    this.state.dataset.done = this.scene && done ? this.scene.number : '';
    for (const [chart, box] of this.boxes) this.draw(chart, box);
    this.showPath();
    this.showList();
    this.showHere();
  }

  showPath() {
    const of = (view) => this.kind === 'worst' ? Math.max(...Object.values(view.strain).map(levelOf)) : levelOf(view.strain[this.kind]);
    this.colour(this.views.map(of), this.views);
  }

  // The nearest view assessed.
  nearest(time_s) {
    return this.views.reduce((best, view) => (best === null || Math.abs(view.time_s - time_s) < Math.abs(best.time_s - time_s) ? view : best), null);
  }

  name(view) {
    return this.scene.continuous ? `${fixed(view.time_s, 2)} s` : `view ${view.view}`;
  }

  showHere() {
    const view = this.time_s === null ? null : this.nearest(this.time_s);
    if (!view) return this.here.replaceChildren();
    const reasons = Object.entries(view.reasons).map(([kind, text]) => element('li', {class: 'reason'}, element('b', {}, `${kNames[kind]}: `), text));
    this.here.replaceChildren(element('h3', {}, `At ${this.name(view)}`),
      reasons.length ? element('ul', {class: 'reasons'}, ...reasons) : element('p', {class: 'quiet'}, 'No limit is exceeded.'));
  }

  // Consecutive views with the same trouble as one entry, which shows its first view.
  showList() {
    const stretches = [];
    for (const kind of Object.keys(kNames)) {
      this.views.forEach((view, i) => {
        if (!view.reasons[kind]) return;
        const last = stretches.at(-1);
        if (last?.kind === kind && last.to === i - 1) last.to = i;
        else stretches.push({kind, from: i, to: i});
      });
    }
    this.list.replaceChildren(...stretches.map(({kind, from, to}) => {
      const [first, last] = [this.views[from], this.views[to]];
      const where = from === to ? this.name(first) : `${this.name(first)} to ${this.name(last)}`;
      return element('li', {}, element('button', {type: 'button', class: 'button', onclick: () => this.choose(first.time_s)},
        element('b', {}, `${kNames[kind]}, ${where}: `), first.reasons[kind]));
    }));
  }

  scale(width) {
    const times = this.views.map(({time_s}) => time_s);
    const {path: places} = this.scene;
    const ends = this.scene.continuous ? [0, places.at(-1).time_s] : [0, Math.max(1, places.length - 1)];
    const x = linear(ends, [kLeft, width - kRight]);
    const of = this.scene.continuous ? (view) => view.time_s : (view) => view.view;
    return {x, of, times};
  }

  draw(chart, box) {
    const width = Math.floor(box.clientWidth);
    if (width < 50 || !this.scene) return;
    const {x, of} = this.scale(width);
    const bottom = kHeight - kBelow;
    const points = this.views.map((view) => ({at: x(of(view)), value: chart.value(view) ?? null, level: chart.kind ? levelOf(view.strain[chart.kind]) : 0}));
    const known = points.map(({value}) => value).filter((value) => value !== null);
    const limit = chart.kind && !chart.log ? limitOf(chart, this.views) : null;
    const top = chart.full ?? Math.max(1e-9, ...known, limit !== null && known.some((value) => value > 0.3 * limit) ? limit : 0) * 1.1;
    const decades = chart.log ? decadesAround(known) : null;
    const y = decades ? logarithmic(decades, [bottom, kTop]) : linear([0, chart.log || known.length === 0 ? 1 : top], [bottom, kTop]);
    // Unknown values beyond a limit, such as an undetermined motion, are marked at the upper edge.
    const parts = [];
    let run = [];
    const close = () => {
      if (run.length > 1) parts.push(path(run, 'curve'));
      run = [];
    };
    const dots = [];
    for (const {at, value, level} of points) {
      if (value === null) {
        close();
        if (level === 2) dots.push(svg('path', {d: `M${at - 4},${kTop - 4}h8l-4,7z`, class: 'dot level-beyond'}));
        continue;
      }
      run.push([at, y(value)]);
      if (level === 2 || points.length <= 40) dots.push(svg('circle', {cx: at, cy: y(value), r: level === 2 ? 3.6 : 2.6, class: `dot level-${kLevels[level]}`}));
    }
    close();
    if (limit !== null && limit <= top) parts.push(line(kLeft, y(limit), width - kRight, y(limit), 'limit'));
    const text = this.scene.continuous ? undefined : (value) => (Number.isInteger(value) ? String(value) : '');
    box.setAttribute('aria-label', `${chart.title}: ${known.length ? `${figure(Math.min(...known))} to ${figure(Math.max(...known))} ${chart.unit}` : 'unknown'}`);
    box.replaceChildren(picture(width, kHeight,
      axisBelow(x, kTop, bottom, {text}),
      known.length ? axisLeft(y, kLeft, width - kRight, {count: 3}) : label('no value yet', {x: width / 2, y: 70, class: 'tick'}),
      ...parts, ...dots, svg('line', {class: 'now', y1: kTop, y2: bottom})));
    this.mark(chart, box);
  }

  mark(chart, box) {
    const now = box.querySelector('.now');
    if (!now || this.time_s === null) return;
    const {x} = this.scale(Math.floor(box.clientWidth));
    const at = x(this.scene.continuous ? this.time_s : this.scene.path.findIndex(({time_s}) => time_s === this.time_s));
    now.setAttribute('x1', at);
    now.setAttribute('x2', at);
  }

  click(event, box) {
    if (!this.views.length) return;
    const {x, of} = this.scale(Math.floor(box.clientWidth));
    const wanted = event.clientX - box.getBoundingClientRect().left;
    const view = this.views.reduce((best, each) => (Math.abs(x(of(each)) - wanted) < Math.abs(x(of(best)) - wanted) ? each : best));
    this.choose(view.time_s);
  }
}
