// SPDX-License-Identifier: Apache-2.0
export function byId(id) {
  return document.getElementById(id);
}

// element('dl', {class: 'figures'}, child, 'text', …). Text is inserted as text, so that names may contain markup.
export function element(name, attributes = {}, ...children) {
  return filled(document.createElement(name), attributes, children);
}

export function svg(name, attributes = {}, ...children) {
  return filled(document.createElementNS('http://www.w3.org/2000/svg', name), attributes, children);
}

function filled(node, attributes, children) {
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith('on')) node.addEventListener(key.slice(2), value);
    else if (value === true) node.setAttribute(key, '');
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(key, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

// A labelled checkbox that calls `change` with its state, initially and on every change.
export function checkbox(label, checked, change) {
  const input = element('input', {type: 'checkbox', checked, onchange: () => change(input.checked)});
  change(checked);
  return element('label', {class: 'check'}, input, element('span', {}, label));
}

// A labelled select element with options [value, text]; calls `change` with the chosen value.
export function choice(label, options, change) {
  const select = element('select', {'aria-label': label, onchange: () => change(select.value)},
    ...options.map(([value, text]) => element('option', {value}, text)));
  return element('label', {class: 'choice'}, element('span', {}, label), select);
}

export function reducedMotion() {
  return matchMedia('(prefers-reduced-motion: reduce)').matches;
}
