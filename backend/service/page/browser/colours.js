// Colours of the style sheet, so that the canvas follows light and dark like the rest of the page.
export function ink(name, element = document.body) {
  return getComputedStyle(element).getPropertyValue(`--${name}`).trim();
}

export function onScheme(listen) {
  const seen = new MutationObserver(listen);
  seen.observe(document.body, { attributes: true, attributeFilter: ["class"] });
  return () => seen.disconnect();
}
