// Elements of the page.

/** An element with these fields and this content. */
export const make = (tag, fields = {}, ...inner) => {
  const element = Object.assign(document.createElement(tag), fields);
  element.append(...inner);
  return element;
};
