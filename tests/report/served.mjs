// SPDX-License-Identifier: Apache-2.0
// Programs that serve a page.
import {spawn} from 'node:child_process';

// Every served program, so that a test can end those that it has left.
const running = new Set();

// Starts a program that prints `${label}: ADDRESS` to standard error, and waits for this line. Fails with what the program
// printed if it exits before.
export async function serveProgram(program, words, label, options = {}) {
  const child = spawn(program, words, {stdio: ['ignore', 'ignore', 'pipe'], ...options});
  running.add(child);
  let printed = '';
  const ended = new Promise((done) => child.on('exit', (code) => {
    running.delete(child);
    done(code);
  }));
  const url = await new Promise((done, failed) => {
    child.stderr.on('data', (bytes) => {
      printed += bytes;
      const [, address] = printed.match(new RegExp(`${label}: (\\S+)\n`)) ?? [];
      if (address) done(address);
    });
    child.on('exit', () => failed(new Error(printed)));
  });
  return {
    url, port: new URL(url).port,
    signal: (name) => child.kill(name),
    // Returns the exit code; null if the signal ended the program.
    stop(signal = 'SIGKILL') {
      child.kill(signal);
      return ended;
    },
  };
}

export function killServed() {
  for (const child of running) child.kill('SIGKILL');
}
