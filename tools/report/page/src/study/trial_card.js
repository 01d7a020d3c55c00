// SPDX-License-Identifier: Apache-2.0
// Facts about the chosen trial.
import {breakable} from '../shared/chart.js';
import {commandLine} from '../shared/copy.js';
import {data} from '../shared/data.js';
import {element} from '../shared/dom.js';
import {figure} from '../shared/format.js';
import {markIcon} from './causes.js';
import {store, trialAt, valueText} from './store.js';
import {causeMeaning, causeName, outcomeOf} from './words.js';

export function facts(rows) {
  return element('dl', {class: 'facts'}, ...rows.flatMap(([title, text]) => [element('dt', {}, ...breakable(title)), element('dd', {}, text)]));
}

export function endOf({outcome, cause}) {
  return outcomeOf(outcome).name + (cause && cause !== outcome ? `: ${causeName(cause)}` : '');
}

function rowsOf(trial) {
  return [
    ['Translation error', trial.translation_mm === null ? 'none measured' : `${figure(trial.translation_mm)} mm`],
    ['Rotation error', trial.rotation_deg === null ? 'none measured' : `${figure(trial.rotation_deg)}°`],
    ...data.parameters.map(({name}, p) => [name, valueText(p, trial.values[p])]),
  ];
}

export function trialCard() {
  const title = element('h3', {id: 'trial-name'});
  const heading = element('div', {'aria-live': 'polite'}, title);
  const rest = element('div', {class: 'trial-rest'});
  store.on(({place}) => {
    if (place < 0) return;
    const trial = trialAt(place);
    title.replaceChildren(markIcon(trial.outcome), `Trial ${trial.trial}: ${endOf(trial)}`);
    const pictured = data.worst.some((worst) => worst.trial === trial.trial);
    rest.replaceChildren(
      element('p', {class: 'quiet note'}, causeMeaning(trial.cause)),
      facts(rowsOf(trial)),
      element('p', {class: 'quiet note'}, 'Command to run it again:'),
      commandLine(data.replay + trial.trial, `trial ${trial.trial}`),
      pictured ? element('p', {}, element('a', {href: `#trial-${trial.trial}`}, 'See its pictures below.')) : '');
  });
  return element('div', {id: 'trial', class: 'card'}, heading, rest);
}
