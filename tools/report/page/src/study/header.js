// SPDX-License-Identifier: Apache-2.0
import {data} from '../shared/data.js';
import {byId} from '../shared/dom.js';
import {count, figure, fixed, percent, plural} from '../shared/format.js';
import {tile} from '../shared/tile.js';
import {ruleText} from './words.js';

const {summary} = data;

export function interval([low, high]) {
  return `${percent(low)} to ${percent(high)}`;
}

export function showHeader() {
  byId('name').textContent = data.name;
  byId('about').textContent = data.description;
  const design = data.design === 'saltelli' ? ' · Saltelli design' : '';
  byId('origin').textContent =
    `${plural(summary.trials, 'trial')} of ${data.scene} · seed ${data.seed}${design} · study ${data.hash} · FringeSLAM ${data.version}`;
  byId('rule').textContent = ruleText();
  const rate = summary.trials ? fixed((100 * summary.successes) / summary.trials, 1) : '–';
  const {count: measured, percentiles} = data.curves.translation_mm;
  const [median, p90, p99] = percentiles.map(([, error]) => error);
  byId('figures').append(
    tile('Success rate', rate, '%', `${count(summary.successes)} of ${count(summary.trials)}; 95 % interval ${interval(summary.success_95)}`));
  if (measured > 0) byId('figures').append(
    tile('Translation error, median', figure(median), 'mm', `of ${plural(measured, 'trial')} with a motion`),
    tile('90th percentile', figure(p90), 'mm'),
    tile('99th percentile', figure(p99), 'mm'),
  );
  if (summary.missing > 0) {
    byId('missing').hidden = false;
    byId('missing').textContent =
      `${plural(summary.missing, 'trial')} of ${count(data.planned)} ${summary.missing === 1 ? 'is' : 'are'} missing: the study is incomplete, and all figures refer to the other trials.`;
  }
  if (data.trials.every > 1) {
    byId('left-out').textContent =
      `The scatter plot shows every ${data.trials.every}th of ${count(summary.trials)} trials and those with pictures; all are in results.csv. All figures and curves include every trial.`;
  }
}
