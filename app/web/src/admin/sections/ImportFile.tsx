/** A file of roads or of elevation on its way to the service, which then says what it would do with it. */
import { useRef, useState } from "preact/hooks";
import { tellDone, tellError } from "../../shared/Messages";
import { t } from "../../shared/texts";
import { OPERATIONS, operationsChanged } from "../actions/operations";
import { withQuery } from "../links";
import { Progress } from "../parts/Progress";
import { send } from "../requests";

const ROADS = ".pbf,.osm,.gz,.bz2";
const TERRAIN = ".tif,.tiff,.hgt,.vrt,.zip";

export function ImportFile({ kind }: { kind: "import-roads" | "import-dem" }) {
  const roads = kind === "import-roads";
  const form = useRef<HTMLFormElement>(null);
  const [share, setShare] = useState<number | null>(null);
  const ending = useRef<AbortController | null>(null);

  async function start(event: Event) {
    event.preventDefault();
    const entries = new FormData(form.current ?? undefined);
    const file = entries.get("file");
    if (!(file instanceof File) || file.size === 0) return;
    const named = String(entries.get("named") ?? "").trim();
    ending.current = new AbortController();
    setShare(0);
    try {
      const said = (name: string) => String(entries.get(name) ?? "").trim();
      const values = roads
        ? { kind, region: named }
        : { kind, priority: named, source: said("source"), licence: said("licence") };
      await send(withQuery(OPERATIONS, values), file, setShare, ending.current.signal);
      tellDone(t(roads ? "admin.import.roads_sent" : "admin.import.terrain_sent", { name: file.name }));
      form.current?.reset();
      operationsChanged();
    } catch (error) {
      if (!(error instanceof DOMException && error.name === "AbortError")) tellError(error);
    }
    setShare(null);
  }

  return (
    <form ref={form} class="import" onSubmit={(event) => void start(event)}>
      <h3>{t(roads ? "admin.import.roads" : "admin.import.terrain")}</h3>
      <p>{t(roads ? "admin.import.roads_what" : "admin.import.terrain_what")}</p>
      <div class="fields">
        <label>
          {t("admin.import.file")}
          <input type="file" name="file" accept={roads ? ROADS : TERRAIN} required />
        </label>
        {roads ? (
          <label>
            {t("admin.import.region")}
            <input type="text" name="named" maxLength={100} />
          </label>
        ) : (
          <>
            <label>
              {t("admin.import.priority")}
              <input type="number" name="named" step={1} />
            </label>
            <label>
              {t("admin.import.source")}
              <input
                type="text"
                name="source"
                maxLength={200}
                placeholder={t("admin.import.source_example")}
              />
            </label>
            <label>
              {t("admin.import.licence")}
              <input type="text" name="licence" maxLength={200} placeholder="CC BY 4.0" />
            </label>
          </>
        )}
        {share === null ? (
          <button type="submit" class="primary">
            {t(roads ? "admin.import.do_roads" : "admin.import.do_terrain")}
          </button>
        ) : (
          <button type="button" onClick={() => ending.current?.abort()}>
            {t("admin.import.stop")}
          </button>
        )}
      </div>
      {share !== null && <Progress share={share} label={t("admin.import.sending")} />}
    </form>
  );
}
