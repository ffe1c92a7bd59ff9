import { Page, show } from "../shared/Page";

function Content() {
  return (
    <Page name="drives">
      <h1>drive</h1>
    </Page>
  );
}

await show("drives", Content);
