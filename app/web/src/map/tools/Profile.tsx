/** Heights and slopes along any line: drawn on the map, or out of a file. */
import { signal } from "@preact/signals";
import { useEffect, useLayoutEffect, useMemo } from "preact/hooks";
import { tellError } from "../../shared/Messages";
import { t } from "../../shared/texts";
import { marks } from "../marks";
import { drawing, shownMap } from "../shown";
import { flyTo, line, type Position } from "../state";
import { Along } from "./Along";
import { addHere, draft, draw, lineMarks, undo } from "./drawing";
import { type FileLine, lineOf } from "./files";
import { decoded, encoded, MOST_CHARACTERS } from "./polyline";

/** The file whose line is shown; its line is in the address as well where it is short. */
const opened = signal<FileLine | null>(null);

function boxOf(points: readonly Position[]): [number, number, number, number] {
  const [lon, lat] = [0, 1].map((axis) => points.map((one) => one[axis] as number)) as [number[], number[]];
  const least = (some: number[]) => some.reduce((a, b) => Math.min(a, b));
  const most = (some: number[]) => some.reduce((a, b) => Math.max(a, b));
  return [least(lon), least(lat), most(lon), most(lat)];
}

/** Show the line of a file. */
export async function take(file: File): Promise<void> {
  try {
    const found = await lineOf(file);
    const text = encoded(found.points);
    opened.value = found;
    line.value = text.length <= MOST_CHARACTERS ? text : "";
    flyTo({ bbox: boxOf(found.points) });
  } catch (error) {
    tellError(error);
  }
}

/** What is shown, and of which file it is. A line that came into the address otherwise is no longer the file's. */
function shown(): { points: readonly Position[]; file: FileLine | null; kept: boolean } {
  const file = opened.value;
  if (line.value === "" && file) return { points: file.points, file, kept: false };
  const ofFile = file !== null && encoded(file.points) === line.value;
  return { points: ofFile ? file.points : decoded(line.value), file: ofFile ? file : null, kept: true };
}

function Drawing() {
  const map = shownMap.value;
  const points = draft.value.length;
  const finish = (some: readonly Position[]) => {
    opened.value = some.length > 0 ? null : opened.value;
    if (some.length > 0) {
      const text = encoded(some);
      if (text.length > MOST_CHARACTERS)
        opened.value = { name: t("tools.profile.drawn"), points: [...some], all: some.length };
      line.value = text.length <= MOST_CHARACTERS ? text : "";
    }
    drawing.value = false;
  };
  // Before it is painted: a key that is pressed as soon as the words are there counts.
  useLayoutEffect(() => (map ? draw(map, finish) : undefined), [map]);
  return (
    <div class="draws">
      <p>{t("tools.profile.drawing")}</p>
      <p class="quiet-text small by-keys">{t("tools.profile.keys")}</p>
      <p role="status">{t("tools.profile.points", { n: points })}</p>
      <div class="buttons panel-actions">
        <button type="button" class="primary" disabled={points < 2} onClick={() => finish(draft.value)}>
          {t("tools.profile.finish")}
        </button>
        <button type="button" onClick={() => map && addHere(map)}>
          {t("tools.profile.add")}
        </button>
        <button type="button" disabled={points === 0} onClick={undo}>
          {t("tools.profile.undo")}
        </button>
        <button type="button" onClick={() => finish([])}>
          {t("tools.profile.cancel")}
        </button>
      </div>
    </div>
  );
}

function Start({ again }: { again: boolean }) {
  return (
    <div class="buttons panel-actions">
      <button type="button" class={again ? "" : "primary"} onClick={() => (drawing.value = true)}>
        {t(again ? "tools.profile.draw_other" : "tools.profile.draw")}
      </button>
      <label class="button file">
        {t("tools.profile.file")}
        <input
          type="file"
          class="unseen"
          accept=".gpx,.geojson,.json,application/gpx+xml,application/geo+json"
          onChange={(event) => {
            const file = event.currentTarget.files?.[0];
            event.currentTarget.value = "";
            if (file) void take(file);
          }}
        />
      </label>
    </div>
  );
}

export default function Profile() {
  const { points, file, kept } = useMemo(shown, [line.value, opened.value]);
  const isDrawing = drawing.value;
  useEffect(() => {
    if (isDrawing) return;
    marks.value = file ? lineMarks(points).slice(0, 1) : lineMarks(points);
    return () => {
      marks.value = [];
    };
  }, [points, isDrawing]);
  useEffect(
    () => () => {
      drawing.value = false;
    },
    [],
  );
  if (isDrawing) return <Drawing />;
  if (points.length < 2)
    return (
      <>
        <p>{t("tools.profile.how")}</p>
        {line.value !== "" && (
          <p class="error-text" role="alert">
            {t("tools.profile.no_line")}
          </p>
        )}
        <Start again={false} />
      </>
    );
  return (
    <>
      {file && (
        <p class="quiet-text small">
          {t("tools.profile.of_file", { name: file.name })}{" "}
          {file.all > file.points.length &&
            t("tools.profile.thinned", { all: file.all, n: file.points.length })}
        </p>
      )}
      {!kept && <p class="note">{t("tools.profile.not_kept")}</p>}
      <Along points={points} />
      <Start again />
    </>
  );
}
