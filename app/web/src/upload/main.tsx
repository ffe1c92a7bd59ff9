import { Page, show } from "../shared/Page";

function Content() {
  return (
    <Page name="upload">
      <h1>upload</h1>
    </Page>
  );
}

await show("upload", Content);
