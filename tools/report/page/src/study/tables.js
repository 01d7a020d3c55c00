// SPDX-License-Identifier: Apache-2.0
// The charts' figures as tables.
import {data} from '../shared/data.js';
import {byId, element} from '../shared/dom.js';
import {amount, count, figure, percent} from '../shared/format.js';
import {head, scroller} from '../shared/tables.js';
import {safeText} from './envelope.js';
import {interval} from './header.js';
import {ranked, sensitivityText} from './sensitivity.js';
import {trialAt, valueText} from './store.js';
import {causeMeaning, causeName, outcomeOf} from './words.js';

const {summary} = data;

function table(titles, rows) {
  const body = rows.map(([first, ...rest]) =>
    element('tr', {}, element('th', {scope: 'row'}, first), ...rest.map((text) => element('td', {}, text))));
  return element('table', {}, head(titles), element('tbody', {}, ...body));
}

// The table is created when it is opened: that of the trials is long.
function folded(title, make) {
  const details = element('details', {class: 'folded'}, element('summary', {}, title));
  details.addEventListener('toggle', () => details.append(scroller(title, make())), {once: true});
  return details;
}

function classTable({classes = []}, p) {
  const isNamed = data.parameters[p].values.length > 0;
  return table([data.parameters[p].name, 'trials', 'success rate', '95 % interval', 'median error mm', '90th percentile mm'],
    classes.map((of) => [
      isNamed ? of.label : of.range.map(amount).join(' to '),
      count(of.trials),
      of.trials ? percent(of.successes / of.trials) : '–',
      interval(of.success_95),
      figure(of.translation_median_mm),
      figure(of.translation_p90_mm),
    ]));
}

function countTable(counts, name, meaning) {
  return table(['', 'trials', 'share', 'meaning'], Object.entries(counts).sort(([, a], [, b]) => b - a)
    .map(([key, number]) => [name(key), count(number), percent(number / summary.trials), meaning(key)]));
}

function percentileTable() {
  const {translation_mm: shift, rotation_deg: turn} = data.curves;
  return table(['percentile', 'translation error mm', 'rotation error °'],
    shift.percentiles.map(([percent, error], i) => [`${percent} %`, figure(error), figure(turn.percentiles[i]?.[1])]));
}

function sensitivityTable() {
  const ofError = new Map(ranked('of_error').map((entry) => [entry.name, entry]));
  return table(['parameter', 'success, first-order', 'success, total', 'error, first-order', 'error, total'],
    ranked('of_success').map((entry) => {
      const error = ofError.get(entry.name);
      return [entry.name, ...[entry, error].flatMap((of) => [sensitivityText(of.first, of.first_95), sensitivityText(of.total, of.total_95)])];
    }));
}

function envelopeTable() {
  return table(['parameter', '99 % success', 'full range'], summary.parameters.map(({name, envelope}, p) => {
    const {low, high, values} = data.parameters[p];
    return [name, safeText(envelope), values.length ? values.join(', ') : `${amount(low)} to ${amount(high)}`];
  }));
}

function trialTable() {
  const rows = data.trials.trial.map((_, place) => trialAt(place));
  return table(['trial', 'outcome', 'cause', 'translation mm', 'rotation °', ...data.parameters.map(({name}) => name)],
    rows.map((trial) => [String(trial.trial), outcomeOf(trial.outcome).name, trial.cause ? causeName(trial.cause) : '',
      figure(trial.translation_mm), figure(trial.rotation_deg), ...trial.values.map((value, p) => valueText(p, value))]));
}

export function showTables() {
  byId('tables').append(
    ...summary.parameters.map((parameter, p) => folded(`Success and error by ${parameter.name}`, () => classTable(parameter, p))),
    folded('Outcomes', () => countTable(summary.outcomes ?? {}, (key) => outcomeOf(key).name, (key) => outcomeOf(key).meaning)),
    folded('Causes of failure', () => countTable(summary.causes ?? {}, causeName, causeMeaning)),
    folded('Percentiles of the errors', percentileTable),
    folded('Sensitivity: share of the variance, with 95 % intervals', sensitivityTable));
  if (summary.envelope) byId('tables').append(folded('Ranges with 99 % success', envelopeTable));
  byId('tables').append(folded('Trials', trialTable));
}
