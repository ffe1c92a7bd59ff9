import { Page, show } from "../shared/Page";

function Content() {
  return (
    <Page name="map">
      <h1>map</h1>
    </Page>
  );
}

await show("map", Content);
