/** What can be done with the part of the map that is shown: a button for each, whose panel is loaded when it is opened. */
import { batch } from "@preact/signals";
import { useEffect, useState } from "preact/hooks";
import { tellError } from "../../shared/Messages";
import { t } from "../../shared/texts";
import { drawing, shownMap } from "../shown";
import { selected, TOOLS, type ToolName, tool } from "../state";
import "./tools.css";

/** Proposals are made by the click that asks for them; a link or a reload makes none. */
export const clicked: { now: ToolName | null } = { now: null };

function open(name: ToolName): void {
  clicked.now = name;
  batch(() => {
    selected.value = null;
    tool.value = name;
  });
}

/** Files that are dropped on the map are lines. */
function useDrop(): void {
  const map = shownMap.value;
  useEffect(() => {
    const place = map?.getContainer();
    if (!place) return;
    const over = (event: DragEvent) => {
      if (event.dataTransfer?.types.includes("Files")) event.preventDefault();
    };
    const drop = (event: DragEvent) => {
      const file = event.dataTransfer?.files[0];
      if (!file) return;
      event.preventDefault();
      drawing.value = false;
      open("profile");
      import("./Profile").then((profile) => profile.take(file)).catch(tellError);
    };
    place.addEventListener("dragover", over);
    place.addEventListener("drop", drop);
    return () => {
      place.removeEventListener("dragover", over);
      place.removeEventListener("drop", drop);
    };
  }, [map]);
}

export function Tools() {
  const [narrow] = useState(() => matchMedia("(max-width: 40rem), (max-height: 30rem)").matches);
  useDrop();
  return (
    <details class="tools card" open={!narrow}>
      <summary>
        <h2>{t("tools.title")}</h2>
      </summary>
      <ul>
        {TOOLS.map((one) => (
          <li key={one}>
            <button type="button" aria-pressed={tool.value === one} onClick={() => open(one)}>
              {t(`tools.${one}.open`)}
            </button>
          </li>
        ))}
      </ul>
    </details>
  );
}
