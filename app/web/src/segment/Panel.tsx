/** What a click on the map opens: a segment, a way with its segments, or below them a tool. On a phone it is a sheet at the bottom. */
import { useEffect, useRef } from "preact/hooks";
import { type Selection, selected, tool } from "../map/state";
import { ToolView } from "../map/tools/ToolView";
import { t } from "../shared/texts";
import { pointedPlace } from "./data";
import { useLoaded } from "./loading";
import "./segment.css";

/** With their charts they are loaded for whoever looks at a road. */
const VIEWS = {
  segment: () => import("./SegmentView").then((one) => one.SegmentView),
  way: () => import("./WayView").then((one) => one.WayView),
};

function View({ kind, id }: Selection) {
  const view = useLoaded(() => VIEWS[kind](), kind);
  if (view.state === "failed") return <p class="error-text">{view.why}</p>;
  return view.state === "there" ? <view.value id={id} /> : <p>{t("segment.asking")}</p>;
}

function close(): void {
  if (selected.value === null) tool.value = null;
  else selected.value = null;
}

export function Panel() {
  const chosen = selected.value;
  const panel = useRef<HTMLElement>(null);
  const before = useRef<Element | null>(null);
  const opened = tool.value;
  const open = chosen !== null || opened !== null;

  // Focus comes into the panel with whatever is chosen, and goes back to where it was.
  useEffect(() => {
    if (!open) return;
    before.current = document.activeElement;
    return () => {
      pointedPlace.value = null;
      const back = before.current;
      if (back instanceof HTMLElement && back !== document.body && back.isConnected) back.focus();
      else document.getElementById("content")?.focus();
    };
  }, [open]);
  useEffect(() => {
    if (open) panel.current?.focus({ preventScroll: true });
    panel.current?.scrollTo(0, 0);
  }, [chosen, opened]);
  useEffect(() => {
    if (!open) return;
    const key = (event: KeyboardEvent) => {
      if (event.key !== "Escape" || event.defaultPrevented || document.querySelector("dialog[open]")) return;
      close();
    };
    document.addEventListener("keydown", key);
    return () => document.removeEventListener("keydown", key);
  }, [open]);

  if (!open) return null;
  return (
    <aside
      class="panel"
      ref={panel}
      // biome-ignore lint/a11y/noNoninteractiveTabindex: focus comes here, and the keyboard scrolls what is long
      tabIndex={0}
      aria-label={
        chosen
          ? t(`segment.panel_${chosen.kind}`, { id: String(chosen.id) })
          : t(`tools.${opened ?? "steepest"}.title`)
      }
    >
      <button type="button" class="quiet panel-close" aria-label={t("page.close")} onClick={close}>
        ×
      </button>
      {chosen ? (
        <View key={`${chosen.kind} ${chosen.id}`} {...chosen} />
      ) : (
        opened && <ToolView key={opened} name={opened} />
      )}
    </aside>
  );
}
