import { Page, show } from "../shared/Page";

function Content() {
  return (
    <Page name="docs">
      <h1>docs</h1>
    </Page>
  );
}

await show("docs", Content);
