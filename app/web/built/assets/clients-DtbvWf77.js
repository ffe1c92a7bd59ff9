var e=`<h1 id="reading-the-map-with-other-programs">Reading the map with other programs</h1>
<p>Everything below comes from one service; <code>http://127.0.0.1:8000</code> stands for its address (<code>VERSANT_PUBLIC_URL</code> where it stands behind another). Slopes are signed, positive uphill from <code>from_node</code> to <code>to_node</code>; unknown is null.
Whatever you make of it is derived from OpenStreetMap: say so (<span>licences</span>). Who would rather have files: <a href="/docs/exports">exports</a>.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>you want</th>
<th>give the program</th>
</tr>
</thead>
<tbody>
<tr>
<td>a map in a page</td>
<td><code>/style.json</code></td>
</tr>
<tr>
<td>vector tiles alone</td>
<td><code>/tiles.json</code>, or <code>/tiles/{z}/{x}/{y}.mvt</code></td>
</tr>
<tr>
<td>segments with all their properties</td>
<td><code>/</code> (OGC API Features), or <code>/collections/segments/items</code></td>
</tr>
<tr>
<td>a client in your own language</td>
<td><code>/openapi.json</code>, for a generator</td>
</tr>
</tbody>
</table></div>
<h2 id="maplibre"><a class="self" href="#maplibre">MapLibre</a></h2>
<pre tabindex="0"><code>new maplibregl.Map({ container: 'map', style: 'http://127.0.0.1:8000/style.json?theme=dark' });
</code></pre>
<p><code>theme=light|dark</code>; <code>colour=steepness|certainty</code>. Colour is how steep a road is, or how sure its slope (one standard deviation); arrows point uphill where the sign is beyond doubt, from zoom 14 on; figures are percent, with their sigma from zoom 17.5 on;
thin grey roads were not driven. In the map of steepness thin lines are unsure. <code>metadata[&quot;versant:legend&quot;]</code> has the classes and their colours. Signs (<code>/sprites/...</code>) and letters (<code>/glyphs/...</code>) come from the service too, so no other host is asked. Letters are
DejaVu's, which are free (Bitstream Vera's licence; DejaVu's changes are in the public domain); a style of your own may ask for <code>DejaVu Sans</code>, <code>DejaVu Sans Bold</code> and <code>DejaVu Sans Oblique</code>. The style is an ordinary one (version 8): save it, change it, keep its source.</p>
<h2 id="qgis"><a class="self" href="#qgis">QGIS</a></h2>
<ul>
<li><strong>Segments</strong>: Layer &gt; Add Layer &gt; Add WFS / OGC API Features Layer, new connection with the service's address, version <em>OGC API - Features</em>, collection <em>segments</em>. Set the page size to 10,000. QGIS 3.22 (Debian 12) reads all segments, but no schema: it guesses types from the first few, so that figures unknown in
these come as text, and numbers of nodes beyond 2,147,483,647 may wrap around. Where these matter, open a file.</li>
<li><strong>Tiles</strong>: Layer &gt; Add Layer &gt; Add Vector Tile Layer, new generic connection; style URL <code>http://127.0.0.1:8000/style.json</code>, source <code>http://127.0.0.1:8000/tiles/{z}/{x}/{y}.mvt</code>, zoom 6 to 18.</li>
<li><strong>Files</strong>: <code>versant export -o slopes.gpkg</code> has its own style inside.</li>
</ul>
<h2 id="gdal"><a class="self" href="#gdal">GDAL</a></h2>
<pre tabindex="0"><code>ogr2ogr -f GPKG slopes.gpkg OAPIF:http://127.0.0.1:8000 segments -oo PAGE_SIZE=10000 -lco FID=fid
ogrinfo -so MVT:http://127.0.0.1:8000/tiles/14 -oo METADATA_FILE=http://127.0.0.1:8000/tiles.json -oo TILE_EXTENSION=mvt
</code></pre>
<p><code>PAGE_SIZE</code> matters to GDAL of Debian 12 and other old ones, which ask for ten features at a time without it. <code>FID=fid</code> keeps the property <code>id</code> apart from the file's own number. Tiles cut lines at their edges; <code>mvt_id</code> is the segment's <code>id</code>.</p>
<h2 id="geopandas"><a class="self" href="#geopandas">geopandas</a></h2>
<pre tabindex="0"><code>import geopandas

slopes = geopandas.read_file(&quot;OAPIF:http://127.0.0.1:8000&quot;, layer=&quot;segments&quot;, bbox=(8.46, 48.95, 8.50, 48.99))
</code></pre>
<h2 id="owslib"><a class="self" href="#owslib">OWSLib</a></h2>
<pre tabindex="0"><code>from owslib.ogcapi.features import Features

service = Features(&quot;http://127.0.0.1:8000&quot;)
page = service.collection_items(&quot;segments&quot;, limit=10000)  # go on with the link whose rel is &quot;next&quot;
</code></pre>
<h2 id="a-generated-client"><a class="self" href="#a-generated-client">A generated client</a></h2>
<p>Any generator that reads OpenAPI 3.1 (or 3.0: <code>/openapi.json?f=openapi-3.0</code>) takes <code>/openapi.json</code>. With openapi-python-client, say that tiles and letters are bytes:</p>
<pre tabindex="0"><code>content_type_overrides:
  application/vnd.mapbox-vector-tile: application/octet-stream
  application/x-protobuf: application/octet-stream
  application/geo+json: application/json
</code></pre>
<h2 id="how-this-is-tested"><a class="self" href="#how-this-is-tested">How this is tested</a></h2>
<p><code>PYTHONPATH=.:benchmarks python -m clients MAP.osm.pbf --maplibre FOLDER</code> lets each of these programs read all of a real map and compares counts, values and types with SQL; <code>benchmarks/clients/__main__.py</code> says what to install. Tests do the same on a small map (<code>tests/app/map/test_clients.py</code>), generate a client
and use it, and hold the style against the specification's own validator where Node finds <code>@maplibre/maplibre-gl-style-spec</code> (<code>NODE_PATH</code>).</p>
`;export{e as default};