/** A table that scrolls by itself, by keyboard too. */
import type { ComponentChildren } from "preact";

export function Scrolled({ name, children }: { name: string; children: ComponentChildren }) {
  return (
    // biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls is reached by keyboard
    <section class="wide" aria-label={name} tabIndex={0}>
      {children}
    </section>
  );
}
