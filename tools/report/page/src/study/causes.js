// SPDX-License-Identifier: Apache-2.0
// Counts of outcomes and causes of failure. Selecting a cause highlights its trials in the scatter plot.
import {data} from '../shared/data.js';
import {byId, element, svg} from '../shared/dom.js';
import {count, percent} from '../shared/format.js';
import {store} from './store.js';
import {causeMeaning, causeName, outcomeOf, outcomes} from './words.js';

const {summary} = data;

function byCount(counts) {
  return Object.entries(counts).sort(([, a], [, b]) => b - a);
}

function bar(number, most, name) {
  const fill = element('span', {class: `fill ${name}`});
  fill.style.width = `${(100 * number) / most}%`;
  return element('span', {class: 'bar', 'aria-hidden': 'true'}, fill);
}

function row(title, number, most, name, meaning) {
  return element('li', {class: 'count'},
    element('span', {class: 'count-name'}, ...title),
    element('b', {class: 'count-number'}, count(number), ' ', element('small', {}, percent(number / summary.trials))),
    bar(number, most, name),
    meaning ? element('span', {class: 'quiet count-meaning'}, meaning) : null);
}

export function markIcon(outcome) {
  return svg('svg', {width: 16, height: 16, class: `mark o-${outcome}`, 'aria-hidden': 'true'},
    svg('path', {d: outcomeOf(outcome).mark(8, 8, 4.5)}));
}

function outcomeRows() {
  const known = Object.entries(summary.outcomes).sort(([a], [b]) => outcomes.indexOf(a) - outcomes.indexOf(b));
  return known.map(([outcome, number]) => {
    const {name, meaning} = outcomeOf(outcome);
    return row([markIcon(outcome), name], number, summary.trials, `o-${outcome}`, meaning);
  });
}

function showTrialsOf(cause) {
  store.pickOut(cause);
  byId('scatter').scrollIntoView({block: 'start'});
  byId('scatter').focus({preventScroll: true});
}

function causeRows() {
  const causes = byCount(summary.causes);
  const most = Math.max(1, ...causes.map(([, number]) => number));
  return causes.map(([cause, number]) => {
    const pick = element('button', {type: 'button', class: 'chooser', 'data-cause': cause, title: 'Show these trials',
      onclick: () => showTrialsOf(cause)}, causeName(cause));
    const worst = data.worst.find((trial) => trial.cause === cause);
    const link = worst ? element('a', {href: `#trial-${worst.trial}`, class: 'count-link'}, `see trial ${worst.trial}`) : null;
    return row([pick, link].filter(Boolean), number, most, 'o-failure', causeMeaning(cause));
  });
}

function list(title, rows, note) {
  return element('div', {class: 'card'}, element('h3', {}, title),
    rows.length ? element('ul', {class: 'counts'}, ...rows) : element('p', {class: 'quiet'}, 'No trial failed.'),
    note ? element('p', {class: 'quiet note'}, note) : null);
}

export function showCauses() {
  byId('causes').append(
    list('Outcomes', outcomeRows()),
    list('Causes of failure', causeRows(),
      'The first cause that applies, from measurements against ground truth. Select a cause to show its trials in the scatter plot.'));
}
