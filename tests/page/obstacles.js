// What keeps people with a keyboard alone, a screen reader or weak eyes from a page, one line each (WCAG 2.2: 1.4.3, 2.1.1, 2.5.3, 4.1.2).
() => {
  const found = [], seen = (e) => e.checkVisibility({ visibilityProperty: true, contentVisibilityAuto: true }) && e.getClientRects().length;
  const brief = (e) => e.cloneNode().outerHTML?.slice(0, 90), plain = (words) => words.replace(/[\p{P}\p{S}\s]+/gu, " ").trim().toLowerCase();
  const canvas = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  // The colours one over the other, as the eye sees them: 0 to 255 each.
  const mixed = (colours) => { canvas.clearRect(0, 0, 1, 1); for (const c of colours) { canvas.fillStyle = c; canvas.fillRect(0, 0, 1, 1); } return [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3); };
  const luminance = (rgb) => { const [r, g, b] = rgb.map((v) => v / 255).map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  for (const e of document.querySelectorAll("body *")) {
    if (!seen(e)) continue;
    const style = getComputedStyle(e), focusable = e.tabIndex >= 0, inside = [...e.querySelectorAll("*")].filter((c) => c.tabIndex >= 0 && seen(c));
    const scrolls = (of, whole, part) => /auto|scroll/.test(of) && whole > part + 1;
    if ((scrolls(style.overflowX, e.scrollWidth, e.clientWidth) || scrolls(style.overflowY, e.scrollHeight, e.clientHeight)) && !focusable && !inside.length) found.push(`no key scrolls ${brief(e)}`);
    if (e.getAttribute("role") === "img" && inside.length) found.push(`an image with parts for the keyboard: ${brief(e)}`);
    const label = e.getAttribute("aria-label"), words = plain(e instanceof SVGElement ? [...e.querySelectorAll("text")].map((t) => t.textContent).join(" ") : e.innerText ?? "");
    if (label && words && (e.localName === "button" || e.getAttribute("role") === "button") && !plain(label).includes(words)) found.push(`"${words}" is called "${label}"`);
    if (!(e instanceof SVGElement) && e.localName !== "textarea" && [...e.childNodes].some((c) => c.nodeType === 3 && c.data.trim())) {
      const grounds = [];
      for (let at = e; at; at = at.parentElement) grounds.unshift(getComputedStyle(at).backgroundColor);
      const [high, low] = [mixed(["white", ...grounds]), mixed(["white", ...grounds, style.color])].map(luminance).sort((a, b) => b - a);
      if (style.opacity === "1" && !e.closest(":disabled") && (high + 0.05) / (low + 0.05) < 4.5) found.push(`contrast ${((high + 0.05) / (low + 0.05)).toFixed(2)} of ${brief(e)}`);
    }
  }
  return found;
}
