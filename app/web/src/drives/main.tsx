import { Page, show } from "../shared/Page";

function Content() {
  return (
    <Page name="drives">
      <h1>drives</h1>
    </Page>
  );
}

await show("drives", Content);
