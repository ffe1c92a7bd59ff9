import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Panel } from "../segment/Panel";
import { Search } from "../segment/Search";
import { goTo } from "../shared/address";
import { tellError } from "../shared/Messages";
import { Page, show } from "../shared/Page";
import { lacksRoads, RoadsAdvice, watchRoads } from "../shared/roads";
import { t } from "../shared/texts";
import { theme } from "../shared/theme";
import { KeptNotice } from "./KeptMaps";
import { type Kept, searchOf } from "./keeping";
import { Legend } from "./Legend";
import { kept, legend, segmentsFrom, shownMap } from "./shown";
import { background, colour, keepAddress, keptId, layer } from "./state";
import { freshStyle, type OwnStyle, ownStyle } from "./style";
import { Tools } from "./tools/Tools";
import "./map.css";

// Both are fetched while the page is put together: the first view waits for them.
const first = ownStyle(theme.value, colour.value, layer.value);
const library = import("./canvas");
const keeping = keptId === null ? null : import("./kept");

type Found = "waiting" | "roads" | "nothing" | "come";
const content = signal<Found>("waiting");
// Where there were none, the map opens by itself when there are.
lacksRoads.subscribe((lacks) => {
  if (!lacks && content.peek() === "nothing") content.value = "come";
});

/** The kept map that the address asks for; where it cannot be had that is told, and today's is shown. */
async function asked(): Promise<Kept | null> {
  if (keptId === null || keeping === null) return null;
  try {
    return await (await keeping).openKept(keptId);
  } catch (error) {
    tellError(error);
    goTo(location.pathname + searchOf(null), true);
    return null;
  }
}

async function open(place: HTMLElement, style = first): Promise<void> {
  const own: OwnStyle = await style;
  kept.value = await asked();
  legend.value = own.legend;
  segmentsFrom.value = own.segmentsFrom;
  if (!own.style.center && kept.value === null) {
    content.value = "nothing";
    lacksRoads.value = true;
    watchRoads();
    return;
  }
  content.value = "roads";
  const { backgroundStyle, openMap } = await library;
  shownMap.value = openMap(place, own, await backgroundStyle(background.value), kept.value);
  keepAddress();
}

function Nothing() {
  return (
    <section class="nothing card">
      <h1>{t("map.no_roads")}</h1>
      <p>{t("map.no_roads_do")}</p>
      <div class="buttons">
        <RoadsAdvice link="button primary" />
        <a class="button" href="/upload">
          {t("map.upload")}
        </a>
      </div>
    </section>
  );
}

function Content() {
  const place = useRef<HTMLDivElement>(null);
  const found = content.value;
  useEffect(() => {
    if (!place.current || found === "roads") return;
    const style = found === "come" ? freshStyle(theme.value, colour.value, layer.value) : first;
    open(place.current, style).catch(tellError);
  }, [found]);
  return (
    <Page name="map" filled>
      <div class="map-page">
        {content.value === "nothing" ? (
          <Nothing />
        ) : (
          <>
            <h1 class="unseen">{t("map.title")}</h1>
            <div class="canvas" ref={place} />
            <div class="map-side">
              <KeptNotice />
              <Search />
              <Tools />
              <Legend />
            </div>
            <Panel />
          </>
        )}
      </div>
    </Page>
  );
}

await show("map", Content);
