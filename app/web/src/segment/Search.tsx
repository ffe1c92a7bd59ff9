/** One field for ways, segments, places and names, with what was found as a list; beside it where one is, and regions. */
import { useEffect, useId, useRef, useState } from "preact/hooks";
import { errorText, tellError } from "../shared/Messages";
import { t } from "../shared/texts";
import { meaning } from "./finding";
import { Locate } from "./Locate";
import { Regions } from "./Regions";
import { type Found, find, type Result } from "./results";
import "./segment.css";

const PATIENCE_MS = 250;
/** The types of inputs know comboboxes with a <datalist> alone. */
const COMBOBOX = { role: "combobox" } as object;

export function Search() {
  const [written, write] = useState("");
  const [answer, set] = useState<Found | null>(null);
  const [at, point] = useState(-1);
  const [open, show] = useState(false);
  const list = useId();
  const field = useRef<HTMLInputElement>(null);
  // Enter was pressed before there was anything to choose.
  const hasty = useRef(false);

  // With the text itself, not in the effect: that runs after the next paint, and Enter may come before it.
  const rewrite = (text: string) => {
    hasty.current = false;
    set(null);
    point(-1);
    write(text);
  };
  useEffect(() => {
    const meant = meaning(written);
    if (meant === null) return;
    const ended = new AbortController();
    const later = setTimeout(() => {
      find(meant, ended.signal).then(
        (some) => {
          set(some);
          const first = some.results[0];
          if (hasty.current && first) go(first);
          else show(true);
        },
        (error) => {
          if (!ended.signal.aborted) set({ results: [], message: errorText(error) });
        },
      );
    }, PATIENCE_MS);
    return () => {
      clearTimeout(later);
      ended.abort();
    };
  }, [written]);

  const results = answer?.results ?? [];
  const shown = open && results.length > 0;
  const go = async (result: Result) => {
    if (result.name !== undefined) {
      rewrite(result.name);
      field.current?.focus();
      return;
    }
    show(false);
    try {
      await result.go();
    } catch (error) {
      tellError(error);
    }
  };
  const key = (event: KeyboardEvent) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step !== undefined && results.length > 0) {
      event.preventDefault();
      show(true);
      // The field itself is one of the stops.
      point(((at + 1 + step + results.length + 1) % (results.length + 1)) - 1);
    } else if (event.key === "Enter") {
      event.preventDefault();
      const result = results[Math.max(at, 0)];
      if (result) go(result);
      else if (answer === null) hasty.current = true;
    } else if (event.key === "Escape" && (shown || written !== "")) {
      event.preventDefault();
      event.stopPropagation();
      if (shown) show(false);
      else rewrite("");
    }
  };
  const message = answer === null ? "" : answer.message || t("segment.found", { n: results.length });
  return (
    <search class="search">
      <div class="search-row">
        {/* biome-ignore lint/a11y/useAriaPropsSupportedByRole: it is a combobox */}
        <input
          ref={field}
          type="search"
          {...COMBOBOX}
          autocomplete="off"
          spellcheck={false}
          maxLength={200}
          aria-label={t("segment.search")}
          placeholder={t("segment.search_hint")}
          aria-expanded={shown}
          aria-controls={list}
          aria-autocomplete="list"
          aria-activedescendant={shown && at >= 0 ? `${list}-${at}` : undefined}
          value={written}
          onInput={(event) => rewrite(event.currentTarget.value)}
          onKeyDown={key}
          onFocus={() => show(true)}
          onBlur={() => show(false)}
        />
        <Locate />
      </div>
      <div id={list} role="listbox" aria-label={t("segment.results")} class="results" hidden={!shown}>
        {results.map((one, n) => (
          // biome-ignore lint/a11y/useKeyWithClickEvents: keys go to the field, which names the option that is meant
          <div
            key={one.key}
            id={`${list}-${n}`}
            role="option"
            tabIndex={-1}
            aria-selected={n === at}
            onMouseDown={(event) => event.preventDefault()}
            onClick={() => go(one)}
          >
            <b>{one.label}</b>
            <span class="quiet-text">{one.detail}</span>
          </div>
        ))}
      </div>
      <p role="status" class={answer?.message ? "search-message" : "unseen"}>
        {message}
      </p>
      <Regions />
    </search>
  );
}
