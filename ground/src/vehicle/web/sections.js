// Sections that open and close: every one of `main` that begins with a heading. On a small screen most begin closed.

/** Small screens, as in page.css. */
const SMALL = "(max-width: 52rem)";

/** Opens a section in which something is to be seen. */
export function unfold(section) {
  section.querySelector("h2 .fold[aria-expanded=false]")?.click();
}

/** Makes the headings of these sections buttons. `open`: ids of those that are open on a small screen, too. */
export function foldable(sections, open) {
  const small = matchMedia(SMALL).matches;
  for (const section of sections) {
    const heading = section.firstElementChild;
    if (heading?.tagName !== "H2") continue;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "fold";
    button.append(...heading.childNodes);
    heading.replaceChildren(button);
    const fold = (closed) => {
      section.classList.toggle("closed", closed);
      button.setAttribute("aria-expanded", String(!closed));
    };
    button.addEventListener("click", () => fold(!section.classList.contains("closed")));
    fold(small && !open.includes(section.id));
  }
}
