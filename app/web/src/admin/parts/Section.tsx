/** A part of the page that can be folded away; what is in it is read only while it is open. */
import type { ComponentChildren, ComponentType } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { moment } from "../../shared/format";
import { t } from "../../shared/texts";
import { wantedSection } from "../page_state";
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
  const wanted = wantedSection.value;
  const [open, setOpen] = useState(atFirst || wanted.id === id);
  useEffect(() => {
    if (wanted.id !== id) return;
    setOpen(true);
    place.current?.scrollIntoView();
    place.current?.querySelector("summary")?.focus();
  }, [wanted, id]);
  return (
    <details
      class="part"
      id={id}
      ref={place}
      open={open}
      onToggle={(event) => setOpen(event.currentTarget.open)}
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
