// SPDX-License-Identifier: Apache-2.0
// Studies whose pages are tested: synthetic results under the hash of a real study.
import {mkdirSync, readFileSync, writeFileSync} from 'node:fs';
import {join} from 'node:path';
import {kWildName, Runs} from './runs.mjs';

export const kTrials = 122;  // and two more, which are missing

function studyText(trials) {
  return `name: '${kWildName.replaceAll("'", "''")}'
description: For the tests of report.html
scene: scene.yaml
trials: ${trials}
seed: 2
parameters:
  light.ambient_lux: {log_uniform: [10, 5000]}
  decode.min_modulation_dn: {uniform: [2, 6]}
  patterns.steps: {choice: [3, 4]}
success: {max_translation_mm: 1, max_rotation_deg: 0.1}
`;
}

// Up to 1000 lux everything succeeds, beyond it nothing does; four trials end in other ways.
const kStrange = {
  7: {outcome: 'crashed', cause: 'crashed', message: 'killed by signal <b id="hurt">'},
  11: {outcome: 'confidently_wrong', cause: 'inaccurate_registration', metrics: {translation_mm: 7, rotation_deg: 0.6}},
  13: {outcome: 'timed_out', cause: 'timed_out', message: 'took longer than 300 s'},
  17: {outcome: 'refused', cause: 'refused', message: 'far_m must be larger than near_m'},
};

function resultOf(trial) {
  const lux = 10 * 500 ** ((trial * 0.6180339887) % 1);
  const values = {'light.ambient_lux': String(lux), 'decode.min_modulation_dn': String(2 + ((trial * 0.7548776662) % 1) * 4), 'patterns.steps': trial % 3 ? '3' : '4'};
  const error = 0.01 * (1 + lux / 100);
  if (kStrange[trial]) return {values, ...kStrange[trial]};
  if (lux < 1000) return {values, outcome: 'success', metrics: {translation_mm: error, rotation_deg: error / 20}};
  if (lux > 2500) return {values, outcome: 'lost', cause: 'too_dark', metrics: {translation_mm: null, rotation_deg: null}};
  return {values, outcome: 'inaccurate', cause: 'wrong_fringe_order', metrics: {translation_mm: 20 * error, rotation_deg: error}};
}

export class Studies extends Runs {
  // Creates a study of `planned` trials and its page from `results`: [{values, outcome, …}], by trial.
  study(name, planned, results, worst) {
    const place = this.scene(name);
    const file = join(place, 'study.yaml');
    writeFileSync(file, studyText(planned));
    const out = this.at(name, 'out');
    this.call('study', 'run', file, '--out', this.at(name, 'one'), '--shard', `0/${planned}`);
    const {study} = JSON.parse(readFileSync(join(this.at(name, 'one'), 'shards', `0-of-${planned}.jsonl`), 'utf8'));
    mkdirSync(join(out, 'shards'), {recursive: true});
    const lines = results.map((result, trial) => `${JSON.stringify({study, trial, seed: trial, ...result})}\n`);
    writeFileSync(join(out, 'shards', '0-of-1.jsonl'), lines.join(''));
    this.call('study', 'report', file, '--out', out, '--worst', String(worst));
    return join(out, 'report.html');
  }

  many(name, worst) {
    return this.study(name, kTrials + 2, Array.from({length: kTrials}, (_, trial) => resultOf(trial)), worst);
  }

  allWell(name) {
    return this.study(name, 40, Array.from({length: 40}, (_, trial) => ({...resultOf(0), values: resultOf(trial).values})), 6);
  }

  // A study of one trial, which has no motion.
  oneLost(name) {
    const result = {...resultOf(0), outcome: 'lost', cause: 'too_few_landmarks', metrics: {translation_mm: null, rotation_deg: null}};
    return this.study(name, 1, [result], 0);
  }
}
