// SPDX-License-Identifier: Apache-2.0
// A command with a button to copy it.
import {element} from './dom.js';

const kSaidMs = 2000;

// Pages opened from files may have no access to the clipboard; the text is then selected for copying by hand.
async function copied(code) {
  try {
    await navigator.clipboard.writeText(code.textContent);
    return true;
  } catch {
    getSelection().selectAllChildren(code);
    return false;
  }
}

export function commandLine(text, name) {
  const code = element('code', {tabindex: '0'}, text);
  const button = element('button', {type: 'button', class: 'button', 'aria-label': `Copy the command of ${name}`}, 'Copy');
  button.addEventListener('click', async () => {
    button.textContent = (await copied(code)) ? 'Copied' : 'Selected';
    setTimeout(() => (button.textContent = 'Copy'), kSaidMs);
  });
  return element('div', {class: 'command'}, code, button);
}
