import { effect } from "@preact/signals";
import { Panel } from "../segment/Panel";
import { Search } from "../segment/Search";
import { Page, show } from "../shared/Page";
import { t } from "../shared/texts";
import { flight, selected } from "./state";

// The map's canvas is drawn by another part; until then what is chosen stands in the address.
const asked = /^#(segment|way)=(\d+)$/.exec(location.hash);
if (asked) selected.value = { kind: asked[1] as "segment" | "way", id: Number(asked[2]) };
effect(() => {
  if (flight.value) document.documentElement.dataset["flight"] = JSON.stringify(flight.value);
});

function Content() {
  return (
    <Page name="map" filled>
      <h1 class="unseen">{t("page.map")}</h1>
      <div
        style={{
          position: "absolute",
          top: "0.75rem",
          left: "0.75rem",
          width: "min(24rem, calc(100% - 1.5rem))",
        }}
      >
        <Search />
      </div>
      <Panel />
    </Page>
  );
}

await show("map", Content);
