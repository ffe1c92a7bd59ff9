/** A part of the page that can be folded away; what is in it is read only while it is open. */
import type { ComponentChildren, ComponentType } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { lookedAt, useFold } from "../../shared/address";
import { moment } from "../../shared/format";
import { t } from "../../shared/texts";
import type { Reading } from "../reading";
import type { Answer } from "../types";

interface SectionProps {
  id: string;
  title: string;
  /** Whether it is open at first. */
  open: boolean;
  Content: ComponentType;
}

export function Section({ id, title, open: atFirst, Content }: SectionProps) {
  const place = useRef<HTMLDetailsElement>(null);
  const [open, fold] = useFold(id, atFirst);
  const looked = lookedAt.value === id;
  useEffect(() => {
    const head = place.current?.querySelector("summary");
    // Whoever opened it by its head is there already.
    if (!looked || !head || head === document.activeElement) return;
    place.current?.scrollIntoView();
    head.focus();
  }, [looked]);
  return (
    <details
      class="part"
      id={id}
      ref={place}
      open={open}
      onToggle={(event) => event.currentTarget.open !== open && fold(event.currentTarget.open)}
    >
      <summary>
        <h2>{title}</h2>
      </summary>
      {open && (
        <div class="inside">
          <Content />
        </div>
      )}
    </details>
  );
}

interface LoadedProps<T> {
  of: Reading<T>;
  children: (data: T) => ComponentChildren;
}

/** What was read, or that it is not there yet; what is wrong stands above what was read before. */
export function Loaded<T>({ of, children }: LoadedProps<T>) {
  if (of.missing.value) return null;
  const data = of.data.value;
  const problem = of.problem.value;
  return (
    <>
      {problem !== null && <p class="error-text">{t("admin.read.problem", { why: problem })}</p>}
      {data === null ? problem === null && <p class="quiet-text">{t("admin.read.first")}</p> : children(data)}
    </>
  );
}

/** Of which moment figures are that a worker makes from time to time. */
export function AsOf({ answer }: { answer: Answer<unknown> }) {
  return <p class="quiet-text">{t("admin.read.as_of", { at: moment(answer.as_of) })}</p>;
}
