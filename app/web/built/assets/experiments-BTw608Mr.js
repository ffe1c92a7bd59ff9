var e=`<h1 id="the-source-documents-experiments-repeated">The source documents' experiments, repeated</h1>
<p>Three documents describe the filters that <code>versant methods</code> lists: Al Assaad 2020 (<code>particle</code>, and the <code>ukf-dem</code> that it compares with), Lahrech, Boucher, Choquel and Noyer 2005 (<code>odometer-map</code>), and Saadaoui 2011 (<code>gps-ins-kf</code>,
<code>gps-ins-ekf</code>, <code>gps-ins-ukf</code>). Their data are not public. Here their experiments are repeated on simulated drives of the same shape, whose truth is known, and every method is scored on surveyed roads.</p>
<pre tabindex="0"><code>python benchmarks/seeds.py ../shared/data/karlsruhe --write
</code></pre>
<p>runs everything (some minutes) and renews the tables on this page; <code>--only calais</code> runs a part, <code>--seeds N</code> sets the number of drives (5 here), <code>--json FILE</code> keeps every seed's figure. A cell holds the median over the seeds;
<code>least</code> and <code>most</code> are the extremes. Below each table stands a sentence for each difference between what the document prints and what we got.</p>
<h2 id="al-assaad-2020-motorway-interchanges-outside-calais"><a class="self" href="#al-assaad-2020-motorway-interchanges-outside-calais">Al Assaad 2020: motorway interchanges outside Calais</a></h2>
<p>The thesis drives 549 s at 1 Hz: up a slope to the A 216, down a bend of 90 degrees to the A 16, and back the same way. Our scene (<code>benchmarks/scenes/calais.py</code>) is fictional and has that shape: two motorways with loops of 60 to 80 m
and turns of 85 to 125 m, 411 to 424 segments in 63 to 72 ways (the thesis: 417 in 73), embankments up to 7 m, 59 to 62 km/h on average over 549 epochs (60 km/h), slopes of about -4 to 5 % (-2.6 to 4.7 %). The vehicle follows smooth curves through the map's nodes and keeps to the right
lane, so the map is half a metre to two metres off, as maps are. Each seed is another scene.</p>
<p>The elevation rasters (<code>benchmarks/scenes/satellite_dem.py</code>) have the thesis's grid of 14,560 posts, see embankments averaged over their resolution, and err by what the thesis enters into its filter: 12.6 m (ASTER) and 6 m (World 30).</p>
<p><strong>What the errors are measured against.</strong> The thesis had no truth: its reference is a particle filter over the GNSS data alone. GNSS heights err slowly, by metres, and both filters follow that error; it cancels in the difference. The
rows &quot;beside GNSS alone&quot; repeat the thesis's comparison, the others are errors against the truth of the simulation.</p>
<p><strong>Altitude, and the limit of 0.6 m.</strong> The receiver's height error has three parts here (<code>RECEIVERS[&quot;m8u&quot;]</code>, derived from the data sheet and the thesis's own error budget): a bias of 2.5 m, multipath of 1.2 m that changes within a minute, and
0.6 m of white noise. The mean over a drive is taken off a standard deviation, so the bias does not count; but whoever does not know the multipath's value cannot tell it from a change of height faster than climb measurements allow. The row
&quot;best possible&quot; is a Kalman filter that knows all of these noises exactly and integrates the best climb that Doppler and pitch give: it errs by 0.62 to 0.67 m on the median drive, more than the limit, and more than twice the 0.30 m that the
thesis prints. So 0.30 m cannot be an error against the truth with such a receiver, and ours cannot be below 0.6 m on every drive either; in the thesis's own terms, beside GNSS alone, ours is. The filter's own sigma says the same.</p>
<p><img src="/web/assets/calais-DXIM73GL.png" alt="Roads of the first scene with the estimated track, and heights along the drive"></p>
<h3 id="calais-chapter-2-particle-variant-ch2-the-thesiss-sensors-aster-like-dem-by-tin"><a class="self" href="#calais-chapter-2-particle-variant-ch2-the-thesiss-sensors-aster-like-dem-by-tin">Calais, chapter 2: particle, variant ch2, the thesis's sensors, ASTER-like DEM by TIN</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>acceleration E, std</td>
<td>m/s2</td>
<td>0.34</td>
<td class="number">0.0586</td>
<td class="number">0.0582</td>
<td class="number">0.0813</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration E, std, beside GNSS alone</td>
<td>m/s2</td>
<td>0.34</td>
<td class="number">0.635</td>
<td class="number">0.627</td>
<td class="number">0.640</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration N, std</td>
<td>m/s2</td>
<td>0.32</td>
<td class="number">0.0582</td>
<td class="number">0.0574</td>
<td class="number">0.0762</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration N, std, beside GNSS alone</td>
<td>m/s2</td>
<td>0.32</td>
<td class="number">0.604</td>
<td class="number">0.590</td>
<td class="number">0.620</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration U, std</td>
<td>m/s2</td>
<td>0.20</td>
<td class="number">0.0295</td>
<td class="number">0.0280</td>
<td class="number">0.0314</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration U, std, beside GNSS alone</td>
<td>m/s2</td>
<td>0.20</td>
<td class="number">0.0550</td>
<td class="number">0.0430</td>
<td class="number">0.0622</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration E, mean</td>
<td>m/s2</td>
<td>0.013</td>
<td class="number">-0.00184</td>
<td class="number">-0.00743</td>
<td class="number">0.00332</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration N, mean</td>
<td>m/s2</td>
<td>0.038</td>
<td class="number">-0.000929</td>
<td class="number">-0.00182</td>
<td class="number">0.00368</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration U, mean</td>
<td>m/s2</td>
<td>-0.0021</td>
<td class="number">-0.0229</td>
<td class="number">-0.0428</td>
<td class="number">0.0216</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity E, std</td>
<td>m/s</td>
<td>1.27</td>
<td class="number">0.536</td>
<td class="number">0.523</td>
<td class="number">0.549</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity E, std, beside GNSS alone</td>
<td>m/s</td>
<td>1.27</td>
<td class="number">0.407</td>
<td class="number">0.404</td>
<td class="number">0.425</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity N, std</td>
<td>m/s</td>
<td>0.94</td>
<td class="number">0.521</td>
<td class="number">0.489</td>
<td class="number">0.549</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity N, std, beside GNSS alone</td>
<td>m/s</td>
<td>0.94</td>
<td class="number">0.414</td>
<td class="number">0.413</td>
<td class="number">0.420</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity U, std</td>
<td>m/s</td>
<td>0.30</td>
<td class="number">0.129</td>
<td class="number">0.120</td>
<td class="number">0.145</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity U, std, beside GNSS alone</td>
<td>m/s</td>
<td>0.30</td>
<td class="number">0.298</td>
<td class="number">0.219</td>
<td class="number">0.363</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity E, mean</td>
<td>m/s</td>
<td>0.069</td>
<td class="number">-0.0114</td>
<td class="number">-0.0205</td>
<td class="number">0.00331</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity N, mean</td>
<td>m/s</td>
<td>0.094</td>
<td class="number">0.000701</td>
<td class="number">-0.0106</td>
<td class="number">0.00474</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity U, mean</td>
<td>m/s</td>
<td>-0.0046</td>
<td class="number">-0.147</td>
<td class="number">-0.287</td>
<td class="number">0.143</td>
<td class="number">5</td>
</tr>
<tr>
<td>position E, std</td>
<td>m</td>
<td>2.8</td>
<td class="number">0.918</td>
<td class="number">0.728</td>
<td class="number">1.09</td>
<td class="number">5</td>
</tr>
<tr>
<td>position E, std, beside GNSS alone</td>
<td>m</td>
<td>2.8</td>
<td class="number">0.350</td>
<td class="number">0.303</td>
<td class="number">0.360</td>
<td class="number">5</td>
</tr>
<tr>
<td>position N, std</td>
<td>m</td>
<td>1.9</td>
<td class="number">0.866</td>
<td class="number">0.663</td>
<td class="number">1.01</td>
<td class="number">5</td>
</tr>
<tr>
<td>position N, std, beside GNSS alone</td>
<td>m</td>
<td>1.9</td>
<td class="number">0.329</td>
<td class="number">0.307</td>
<td class="number">0.361</td>
<td class="number">5</td>
</tr>
<tr>
<td>position U, std</td>
<td>m</td>
<td>0.6</td>
<td class="number">1.12</td>
<td class="number">0.799</td>
<td class="number">1.52</td>
<td class="number">5</td>
</tr>
<tr>
<td>position U, std, beside GNSS alone</td>
<td>m</td>
<td>0.6</td>
<td class="number">0.754</td>
<td class="number">0.532</td>
<td class="number">0.888</td>
<td class="number">5</td>
</tr>
<tr>
<td>position E, mean</td>
<td>m</td>
<td>0.24</td>
<td class="number">0.176</td>
<td class="number">-1.46</td>
<td class="number">1.02</td>
<td class="number">5</td>
</tr>
<tr>
<td>position N, mean</td>
<td>m</td>
<td>0.32</td>
<td class="number">0.292</td>
<td class="number">-1.66</td>
<td class="number">0.825</td>
<td class="number">5</td>
</tr>
<tr>
<td>position U, mean</td>
<td>m</td>
<td>-0.11</td>
<td class="number">-3.43</td>
<td class="number">-6.55</td>
<td class="number">1.92</td>
<td class="number">5</td>
</tr>
<tr>
<td>altitude, the filter's own sigma</td>
<td>m</td>
<td>-</td>
<td class="number">3.41</td>
<td class="number">3.39</td>
<td class="number">3.41</td>
<td class="number">5</td>
</tr>
<tr>
<td>altitude, best possible std</td>
<td>m</td>
<td>-</td>
<td class="number">0.635</td>
<td class="number">0.623</td>
<td class="number">0.672</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, std</td>
<td>m</td>
<td>0.90</td>
<td class="number">1.01</td>
<td class="number">0.807</td>
<td class="number">1.26</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, std, beside GNSS alone</td>
<td>m</td>
<td>0.90</td>
<td class="number">0.640</td>
<td class="number">0.435</td>
<td class="number">0.687</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, max</td>
<td>m</td>
<td>6</td>
<td class="number">6.27</td>
<td class="number">5.22</td>
<td class="number">9.89</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, max, beside GNSS alone</td>
<td>m</td>
<td>6</td>
<td class="number">6.56</td>
<td class="number">3.42</td>
<td class="number">7.43</td>
<td class="number">5</td>
</tr>
<tr>
<td>yaw, std</td>
<td>rad</td>
<td>0.14</td>
<td class="number">0.0633</td>
<td class="number">0.0542</td>
<td class="number">0.0639</td>
<td class="number">5</td>
</tr>
<tr>
<td>yaw, mean</td>
<td>rad</td>
<td>0.010</td>
<td class="number">0.00678</td>
<td class="number">0.00187</td>
<td class="number">0.0145</td>
<td class="number">5</td>
</tr>
<tr>
<td>pitch, std</td>
<td>rad</td>
<td>0.05</td>
<td class="number">0.0150</td>
<td class="number">0.0124</td>
<td class="number">0.0181</td>
<td class="number">5</td>
</tr>
<tr>
<td>pitch, mean</td>
<td>rad</td>
<td>-0.0052</td>
<td class="number">-0.0102</td>
<td class="number">-0.0200</td>
<td class="number">0.0102</td>
<td class="number">5</td>
</tr>
<tr>
<td>map-match rate</td>
<td>%</td>
<td>94.35</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
<tr>
<td>matches on the segment driven</td>
<td>%</td>
<td>-</td>
<td class="number">96.2</td>
<td class="number">95.6</td>
<td class="number">97.8</td>
<td class="number">5</td>
</tr>
<tr>
<td>epochs resampled</td>
<td>%</td>
<td>57</td>
<td class="number">99.6</td>
<td class="number">99.5</td>
<td class="number">99.6</td>
<td class="number">5</td>
</tr>
<tr>
<td>epochs resampled, threshold 0.1</td>
<td>%</td>
<td>57</td>
<td class="number">31.1</td>
<td class="number">30.8</td>
<td class="number">31.5</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<ul>
<li>acceleration E, std; acceleration N, std; acceleration U, std: Against the truth the error is the accelerometer's own noise of 0.05 m/s2; the thesis compares with a reference that has no accelerometer.</li>
<li>acceleration E, std, beside GNSS alone; acceleration N, std, beside GNSS alone; acceleration U, std, beside GNSS alone: The reference learns of a change of speed from positions alone, seconds late, and nearly all of the difference is its error; how late depends on its process noise, which the thesis does not state.</li>
<li>acceleration E, mean; acceleration N, mean; velocity E, mean; velocity N, mean: Over one drive a mean is what is left of slow errors, and its sign is chance; ours is smaller than the printed one.</li>
<li>acceleration U, mean; velocity U, mean; pitch, mean: Each axis of our accelerometer has a bias of 0.05 m/s2 (one sigma), and chapter 2 has nothing to hold its climb against; without the bias these means vanish. The thesis calibrated its sensor.</li>
<li>velocity E, std; velocity N, std; velocity U, std: Without Doppler velocity follows from positions and acceleration. The printed figure is a difference from a reference that has no acceleration either, at process noises that the thesis does not state.</li>
<li>position E, std; position N, std: The map of the scene is true to half a metre, the lane within two, and GNSS errs by 2 m in the plane: there is less to disagree about than the thesis had between its receiver and OpenStreetMap.</li>
<li>position U, std: Slow GNSS errors, which the thesis's reference shares, and ASTER's bumps remain against the truth; beside GNSS alone, which is what the thesis prints, ours is about as small as its.</li>
<li>position E, mean; position N, mean: GNSS errors that last for minutes, of up to 2 m, stay in the mean.</li>
<li>position U, mean: The receiver's height has a bias of 2.5 m (one sigma) for a whole drive, and the estimate follows it.</li>
<li>yaw, std: Standstill, where a heading is chance, is left out here; the thesis does not say over which epochs it counts.</li>
<li>pitch, std: Standstill, where vz / v is any number, is left out here, and the true climb is known; the thesis's comes from GNSS heights.</li>
<li>map-match rate: Every road that is driven is in our map, and none is off by more than its stated accuracy; the thesis does not say where its epochs without a match lie.</li>
<li>epochs resampled; epochs resampled, threshold 0.1: With N_eff below 2/3 of the particles nearly every epoch is resampled, with 0.1 a third; the thesis names both thresholds, and its share lies between.</li>
</ul>
<h3 id="calais-chapter-3-particle-variant-ch3-the-thesiss-sensors-world-30-like-dem-by-fga"><a class="self" href="#calais-chapter-3-particle-variant-ch3-the-thesiss-sensors-world-30-like-dem-by-fga">Calais, chapter 3: particle, variant ch3, the thesis's sensors, World-30-like DEM by FGA</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>acceleration E, std</td>
<td>m/s2</td>
<td>-</td>
<td class="number">0.0586</td>
<td class="number">0.0582</td>
<td class="number">0.0814</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration E, std, beside GNSS alone</td>
<td>m/s2</td>
<td>-</td>
<td class="number">0.635</td>
<td class="number">0.627</td>
<td class="number">0.640</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration N, std</td>
<td>m/s2</td>
<td>-</td>
<td class="number">0.0582</td>
<td class="number">0.0574</td>
<td class="number">0.0764</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration N, std, beside GNSS alone</td>
<td>m/s2</td>
<td>-</td>
<td class="number">0.603</td>
<td class="number">0.590</td>
<td class="number">0.620</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration U, std</td>
<td>m/s2</td>
<td>-</td>
<td class="number">0.0355</td>
<td class="number">0.0344</td>
<td class="number">0.0367</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration U, std, beside GNSS alone</td>
<td>m/s2</td>
<td>-</td>
<td class="number">0.0598</td>
<td class="number">0.0478</td>
<td class="number">0.0675</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity E, std</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.555</td>
<td class="number">0.534</td>
<td class="number">0.578</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity E, std, beside GNSS alone</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.412</td>
<td class="number">0.404</td>
<td class="number">0.431</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity N, std</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.535</td>
<td class="number">0.500</td>
<td class="number">0.563</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity N, std, beside GNSS alone</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.416</td>
<td class="number">0.406</td>
<td class="number">0.420</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity U, std</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.123</td>
<td class="number">0.123</td>
<td class="number">0.129</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity U, std, beside GNSS alone</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.330</td>
<td class="number">0.250</td>
<td class="number">0.374</td>
<td class="number">5</td>
</tr>
<tr>
<td>position E, std</td>
<td>m</td>
<td>-</td>
<td class="number">0.931</td>
<td class="number">0.729</td>
<td class="number">1.10</td>
<td class="number">5</td>
</tr>
<tr>
<td>position E, std, beside GNSS alone</td>
<td>m</td>
<td>-</td>
<td class="number">0.355</td>
<td class="number">0.330</td>
<td class="number">0.379</td>
<td class="number">5</td>
</tr>
<tr>
<td>position N, std</td>
<td>m</td>
<td>-</td>
<td class="number">0.865</td>
<td class="number">0.674</td>
<td class="number">1.01</td>
<td class="number">5</td>
</tr>
<tr>
<td>position N, std, beside GNSS alone</td>
<td>m</td>
<td>-</td>
<td class="number">0.337</td>
<td class="number">0.316</td>
<td class="number">0.378</td>
<td class="number">5</td>
</tr>
<tr>
<td>position U, std</td>
<td>m</td>
<td>0.30</td>
<td class="number">0.993</td>
<td class="number">0.733</td>
<td class="number">1.50</td>
<td class="number">5</td>
</tr>
<tr>
<td>position U, std, beside GNSS alone</td>
<td>m</td>
<td>0.30</td>
<td class="number">1.22</td>
<td class="number">1.12</td>
<td class="number">1.34</td>
<td class="number">5</td>
</tr>
<tr>
<td>altitude, the filter's own sigma</td>
<td>m</td>
<td>-</td>
<td class="number">1.27</td>
<td class="number">1.26</td>
<td class="number">1.36</td>
<td class="number">5</td>
</tr>
<tr>
<td>altitude, best possible std</td>
<td>m</td>
<td>-</td>
<td class="number">0.635</td>
<td class="number">0.623</td>
<td class="number">0.672</td>
<td class="number">5</td>
</tr>
<tr>
<td>yaw, std</td>
<td>rad</td>
<td>-</td>
<td class="number">0.0626</td>
<td class="number">0.0602</td>
<td class="number">0.0639</td>
<td class="number">5</td>
</tr>
<tr>
<td>pitch, std</td>
<td>rad</td>
<td>0.05 (ch. 2)</td>
<td class="number">0.00744</td>
<td class="number">0.00718</td>
<td class="number">0.00771</td>
<td class="number">5</td>
</tr>
<tr>
<td>map-match rate</td>
<td>%</td>
<td>94.35 (ch. 2)</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
<tr>
<td>matches on the segment driven</td>
<td>%</td>
<td>-</td>
<td class="number">96.2</td>
<td class="number">95.6</td>
<td class="number">97.8</td>
<td class="number">5</td>
</tr>
<tr>
<td>epochs resampled</td>
<td>%</td>
<td>57</td>
<td class="number">99.6</td>
<td class="number">99.6</td>
<td class="number">99.6</td>
<td class="number">5</td>
</tr>
<tr>
<td>segments with a slope</td>
<td></td>
<td>46</td>
<td class="number">59.0</td>
<td class="number">56.0</td>
<td class="number">62.0</td>
<td class="number">5</td>
</tr>
<tr>
<td>driven segments with a slope</td>
<td>%</td>
<td>about half</td>
<td class="number">46.9</td>
<td class="number">44.4</td>
<td class="number">48.1</td>
<td class="number">5</td>
</tr>
<tr>
<td>most epochs on a segment</td>
<td></td>
<td>25</td>
<td class="number">24.0</td>
<td class="number">22.0</td>
<td class="number">25.0</td>
<td class="number">5</td>
</tr>
<tr>
<td>steepest slope down</td>
<td>%</td>
<td>-2.6</td>
<td class="number">-2.80</td>
<td class="number">-4.33</td>
<td class="number">-1.92</td>
<td class="number">5</td>
</tr>
<tr>
<td>steepest slope up</td>
<td>%</td>
<td>4.7</td>
<td class="number">4.58</td>
<td class="number">3.78</td>
<td class="number">4.74</td>
<td class="number">5</td>
</tr>
<tr>
<td>slope error, RMS</td>
<td>%</td>
<td>-</td>
<td class="number">0.572</td>
<td class="number">0.504</td>
<td class="number">0.633</td>
<td class="number">5</td>
</tr>
<tr>
<td>slope errors within 1.96 sigma</td>
<td>%</td>
<td>-</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<ul>
<li>position U, std: Slow GNSS errors remain against the truth. Beside positions alone ours is no closer than in chapter 2, for pitch takes the estimate away from a reference that knows climb only from heights; beside a reference with velocity it is as printed (next table).</li>
<li>pitch, std: Standstill, where vz / v is any number, is left out here, and the true climb is known; the thesis's comes from GNSS heights.</li>
<li>map-match rate: Every road that is driven is in our map, and none is off by more than its stated accuracy; the thesis does not say where its epochs without a match lie.</li>
<li>epochs resampled: With N_eff below 2/3 of the particles nearly every epoch is resampled, with 0.1 a third; the thesis names both thresholds, and its share lies between.</li>
<li>steepest slope down; steepest slope up: Another scene: the true slopes of segments with four epochs and more reach from about -4 to 5 %.</li>
</ul>
<h3 id="calais-chapter-3-with-doppler-velocity-as-particle-does-by-default"><a class="self" href="#calais-chapter-3-with-doppler-velocity-as-particle-does-by-default">Calais, chapter 3 with Doppler velocity, as particle does by default</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>acceleration E, std</td>
<td>m/s2</td>
<td>-</td>
<td class="number">0.0577</td>
<td class="number">0.0573</td>
<td class="number">0.0799</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration E, std, beside GNSS alone</td>
<td>m/s2</td>
<td>-</td>
<td class="number">0.240</td>
<td class="number">0.231</td>
<td class="number">0.248</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration N, std</td>
<td>m/s2</td>
<td>-</td>
<td class="number">0.0577</td>
<td class="number">0.0561</td>
<td class="number">0.0749</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration N, std, beside GNSS alone</td>
<td>m/s2</td>
<td>-</td>
<td class="number">0.233</td>
<td class="number">0.227</td>
<td class="number">0.240</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration U, std</td>
<td>m/s2</td>
<td>-</td>
<td class="number">0.0396</td>
<td class="number">0.0380</td>
<td class="number">0.0399</td>
<td class="number">5</td>
</tr>
<tr>
<td>acceleration U, std, beside GNSS alone</td>
<td>m/s2</td>
<td>-</td>
<td class="number">0.0461</td>
<td class="number">0.0449</td>
<td class="number">0.0491</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity E, std</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.0502</td>
<td class="number">0.0469</td>
<td class="number">0.0512</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity E, std, beside GNSS alone</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.00612</td>
<td class="number">0.00589</td>
<td class="number">0.00655</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity N, std</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.0502</td>
<td class="number">0.0469</td>
<td class="number">0.0507</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity N, std, beside GNSS alone</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.00607</td>
<td class="number">0.00574</td>
<td class="number">0.00653</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity U, std</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.0721</td>
<td class="number">0.0708</td>
<td class="number">0.0751</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity U, std, beside GNSS alone</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.0363</td>
<td class="number">0.0346</td>
<td class="number">0.0400</td>
<td class="number">5</td>
</tr>
<tr>
<td>position E, std</td>
<td>m</td>
<td>-</td>
<td class="number">1.12</td>
<td class="number">1.01</td>
<td class="number">1.26</td>
<td class="number">5</td>
</tr>
<tr>
<td>position E, std, beside GNSS alone</td>
<td>m</td>
<td>-</td>
<td class="number">0.129</td>
<td class="number">0.103</td>
<td class="number">0.171</td>
<td class="number">5</td>
</tr>
<tr>
<td>position N, std</td>
<td>m</td>
<td>-</td>
<td class="number">0.995</td>
<td class="number">0.944</td>
<td class="number">1.13</td>
<td class="number">5</td>
</tr>
<tr>
<td>position N, std, beside GNSS alone</td>
<td>m</td>
<td>-</td>
<td class="number">0.130</td>
<td class="number">0.0960</td>
<td class="number">0.167</td>
<td class="number">5</td>
</tr>
<tr>
<td>position U, std</td>
<td>m</td>
<td>0.30</td>
<td class="number">0.788</td>
<td class="number">0.423</td>
<td class="number">1.14</td>
<td class="number">5</td>
</tr>
<tr>
<td>position U, std, beside GNSS alone</td>
<td>m</td>
<td>0.30</td>
<td class="number">0.300</td>
<td class="number">0.236</td>
<td class="number">0.401</td>
<td class="number">5</td>
</tr>
<tr>
<td>position U, std, receiver m8</td>
<td>m</td>
<td>0.30</td>
<td class="number">1.30</td>
<td class="number">1.14</td>
<td class="number">2.74</td>
<td class="number">5</td>
</tr>
<tr>
<td>position U, std, receiver m8, beside GNSS alone</td>
<td>m</td>
<td>0.30</td>
<td class="number">0.427</td>
<td class="number">0.327</td>
<td class="number">0.473</td>
<td class="number">5</td>
</tr>
<tr>
<td>altitude, the filter's own sigma</td>
<td>m</td>
<td>-</td>
<td class="number">0.799</td>
<td class="number">0.785</td>
<td class="number">0.834</td>
<td class="number">5</td>
</tr>
<tr>
<td>altitude, best possible std</td>
<td>m</td>
<td>-</td>
<td class="number">0.635</td>
<td class="number">0.623</td>
<td class="number">0.672</td>
<td class="number">5</td>
</tr>
<tr>
<td>altitude, best possible std, receiver m8</td>
<td>m</td>
<td>-</td>
<td class="number">1.00</td>
<td class="number">0.952</td>
<td class="number">1.06</td>
<td class="number">5</td>
</tr>
<tr>
<td>yaw, std</td>
<td>rad</td>
<td>-</td>
<td class="number">0.00469</td>
<td class="number">0.00415</td>
<td class="number">0.00480</td>
<td class="number">5</td>
</tr>
<tr>
<td>pitch, std</td>
<td>rad</td>
<td>0.05 (ch. 2)</td>
<td class="number">0.00512</td>
<td class="number">0.00495</td>
<td class="number">0.00516</td>
<td class="number">5</td>
</tr>
<tr>
<td>map-match rate</td>
<td>%</td>
<td>94.35 (ch. 2)</td>
<td class="number">99.8</td>
<td class="number">99.6</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
<tr>
<td>matches on the segment driven</td>
<td>%</td>
<td>-</td>
<td class="number">96.9</td>
<td class="number">96.7</td>
<td class="number">97.4</td>
<td class="number">5</td>
</tr>
<tr>
<td>epochs resampled</td>
<td>%</td>
<td>57</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
<tr>
<td>segments with a slope</td>
<td></td>
<td>46</td>
<td class="number">56.0</td>
<td class="number">54.0</td>
<td class="number">61.0</td>
<td class="number">5</td>
</tr>
<tr>
<td>driven segments with a slope</td>
<td>%</td>
<td>about half</td>
<td class="number">44.1</td>
<td class="number">42.9</td>
<td class="number">47.3</td>
<td class="number">5</td>
</tr>
<tr>
<td>most epochs on a segment</td>
<td></td>
<td>25</td>
<td class="number">24.0</td>
<td class="number">22.0</td>
<td class="number">25.0</td>
<td class="number">5</td>
</tr>
<tr>
<td>steepest slope down</td>
<td>%</td>
<td>-2.6</td>
<td class="number">-1.70</td>
<td class="number">-4.27</td>
<td class="number">-1.42</td>
<td class="number">5</td>
</tr>
<tr>
<td>steepest slope up</td>
<td>%</td>
<td>4.7</td>
<td class="number">3.92</td>
<td class="number">3.53</td>
<td class="number">4.76</td>
<td class="number">5</td>
</tr>
<tr>
<td>slope error, RMS</td>
<td>%</td>
<td>-</td>
<td class="number">0.245</td>
<td class="number">0.236</td>
<td class="number">0.342</td>
<td class="number">5</td>
</tr>
<tr>
<td>slope errors within 1.96 sigma</td>
<td>%</td>
<td>-</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<ul>
<li>position U, std: Beside GNSS alone, the thesis's measure, it is as printed and below 0.6 m on every drive. Against the truth the median drive errs by about as much as a filter that knows all noises exactly (the row best possible): a height that is off by 1.2 m for a minute cannot be told from a hill.</li>
<li>position U, std, receiver m8: Profile m8 errs by 3 m with a time constant of two minutes: the error against the truth grows with the receiver's, the difference from GNSS alone far less.</li>
<li>pitch, std: Standstill, where vz / v is any number, is left out here, and the true climb is known; the thesis's comes from GNSS heights.</li>
<li>map-match rate: Every road that is driven is in our map, and none is off by more than its stated accuracy; the thesis does not say where its epochs without a match lie.</li>
<li>epochs resampled: With N_eff below 2/3 of the particles nearly every epoch is resampled, with 0.1 a third; the thesis names both thresholds, and its share lies between.</li>
<li>steepest slope down; steepest slope up: Another scene: the true slopes of segments with four epochs and more reach from about -4 to 5 %.</li>
</ul>
<h3 id="calais-ukf-dem-aster-like-dem-by-tin"><a class="self" href="#calais-ukf-dem-aster-like-dem-by-tin">Calais: ukf-dem, ASTER-like DEM by TIN</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>velocity E, std</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.853</td>
<td class="number">0.831</td>
<td class="number">0.887</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity E, std, beside GNSS alone</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.758</td>
<td class="number">0.715</td>
<td class="number">0.793</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity N, std</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.898</td>
<td class="number">0.872</td>
<td class="number">0.973</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity N, std, beside GNSS alone</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.819</td>
<td class="number">0.780</td>
<td class="number">0.908</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity U, std</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.356</td>
<td class="number">0.253</td>
<td class="number">0.365</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity U, std, beside GNSS alone</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.443</td>
<td class="number">0.319</td>
<td class="number">0.456</td>
<td class="number">5</td>
</tr>
<tr>
<td>position E, std</td>
<td>m</td>
<td>-</td>
<td class="number">0.890</td>
<td class="number">0.734</td>
<td class="number">1.03</td>
<td class="number">5</td>
</tr>
<tr>
<td>position E, std, beside GNSS alone</td>
<td>m</td>
<td>-</td>
<td class="number">0.263</td>
<td class="number">0.235</td>
<td class="number">0.275</td>
<td class="number">5</td>
</tr>
<tr>
<td>position N, std</td>
<td>m</td>
<td>-</td>
<td class="number">0.817</td>
<td class="number">0.601</td>
<td class="number">0.971</td>
<td class="number">5</td>
</tr>
<tr>
<td>position N, std, beside GNSS alone</td>
<td>m</td>
<td>-</td>
<td class="number">0.252</td>
<td class="number">0.232</td>
<td class="number">0.341</td>
<td class="number">5</td>
</tr>
<tr>
<td>position U, std</td>
<td>m</td>
<td>-</td>
<td class="number">2.77</td>
<td class="number">1.92</td>
<td class="number">3.41</td>
<td class="number">5</td>
</tr>
<tr>
<td>position U, std, beside GNSS alone</td>
<td>m</td>
<td>-</td>
<td class="number">2.58</td>
<td class="number">1.77</td>
<td class="number">3.18</td>
<td class="number">5</td>
</tr>
<tr>
<td>yaw, std</td>
<td>rad</td>
<td>-</td>
<td class="number">0.120</td>
<td class="number">0.105</td>
<td class="number">0.131</td>
<td class="number">5</td>
</tr>
<tr>
<td>pitch, std</td>
<td>rad</td>
<td>-</td>
<td class="number">0.0511</td>
<td class="number">0.0286</td>
<td class="number">0.0620</td>
<td class="number">5</td>
</tr>
<tr>
<td>map-match rate</td>
<td>%</td>
<td>-</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
<tr>
<td>matches on the segment driven</td>
<td>%</td>
<td>-</td>
<td class="number">94.9</td>
<td class="number">94.2</td>
<td class="number">96.2</td>
<td class="number">5</td>
</tr>
<tr>
<td>segments with a slope</td>
<td></td>
<td>46</td>
<td class="number">56.0</td>
<td class="number">53.0</td>
<td class="number">60.0</td>
<td class="number">5</td>
</tr>
<tr>
<td>driven segments with a slope</td>
<td>%</td>
<td>about half</td>
<td class="number">43.8</td>
<td class="number">42.4</td>
<td class="number">46.5</td>
<td class="number">5</td>
</tr>
<tr>
<td>most epochs on a segment</td>
<td></td>
<td>25</td>
<td class="number">25.0</td>
<td class="number">22.0</td>
<td class="number">26.0</td>
<td class="number">5</td>
</tr>
<tr>
<td>steepest slope down</td>
<td>%</td>
<td>-2.6</td>
<td class="number">-5.75</td>
<td class="number">-8.01</td>
<td class="number">-2.74</td>
<td class="number">5</td>
</tr>
<tr>
<td>steepest slope up</td>
<td>%</td>
<td>4.7</td>
<td class="number">5.68</td>
<td class="number">4.03</td>
<td class="number">8.77</td>
<td class="number">5</td>
</tr>
<tr>
<td>slope error, RMS</td>
<td>%</td>
<td>-</td>
<td class="number">2.26</td>
<td class="number">1.68</td>
<td class="number">2.75</td>
<td class="number">5</td>
</tr>
<tr>
<td>slope errors within 1.96 sigma</td>
<td>%</td>
<td>-</td>
<td class="number">94.6</td>
<td class="number">90.7</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<ul>
<li>position U, std: The thesis cites this system without figures (its reference [29]); the rows stand for comparison.</li>
</ul>
<h2 id="lahrech-et-al-2005-325-s-in-town-with-two-outages"><a class="self" href="#lahrech-et-al-2005-325-s-in-town-with-two-outages">Lahrech et al. 2005: 325 s in town with two outages</a></h2>
<p>The paper drives 325 s at 1 Hz at up to 16.5 m/s, with halts, and loses GPS twice, for 40 s and for 31 s. Ours (<code>benchmarks/scenes/lahrech.py</code>) does so in the simulated town, another town for each seed. The odometers' &quot;reliability of 90 %&quot; is read as an
error of 10 % of what the wheels turn between two readings, one sigma, drawn anew each second and common to both wheels, besides 1 % of each wheel's own: it gives the speed error of about 1 m/s that the paper shows. An error of 10 % of each wheel on
its own would mean 0.9 rad of heading per second at 10 m/s, and the paper's odometers do detect turns.</p>
<h3 id="lahrech-as-printed-policy-paper-v_k-dt-map-of-points-every-5-m-wheels-of-10"><a class="self" href="#lahrech-as-printed-policy-paper-v_k-dt-map-of-points-every-5-m-wheels-of-10">Lahrech, as printed: policy paper, v_k dt, map of points every 5 m, wheels of 10 %</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>horizontal position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">1.92</td>
<td class="number">0.677</td>
<td class="number">25.9</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, mean</td>
<td>m</td>
<td>-</td>
<td class="number">3.86</td>
<td class="number">1.82</td>
<td class="number">16.2</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, max</td>
<td>m</td>
<td>-</td>
<td class="number">7.85</td>
<td class="number">3.55</td>
<td class="number">102</td>
<td class="number">5</td>
</tr>
<tr>
<td>filter's own sigma, rms</td>
<td>m</td>
<td>-</td>
<td class="number">2.68</td>
<td class="number">2.55</td>
<td class="number">9.32</td>
<td class="number">5</td>
</tr>
<tr>
<td>error over own sigma, rms</td>
<td></td>
<td>-</td>
<td class="number">2.02</td>
<td class="number">0.834</td>
<td class="number">2.59</td>
<td class="number">5</td>
</tr>
<tr>
<td>odometer alone, 10 % of the way, end of an outage</td>
<td>m</td>
<td>-</td>
<td class="number">6.50</td>
<td class="number">4.72</td>
<td class="number">9.99</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">5.21</td>
<td class="number">2.28</td>
<td class="number">25.8</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, mean</td>
<td>m</td>
<td>3.16</td>
<td class="number">6.90</td>
<td class="number">4.84</td>
<td class="number">16.6</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, max</td>
<td>m</td>
<td>7</td>
<td class="number">20.4</td>
<td class="number">11.5</td>
<td class="number">103</td>
<td class="number">5</td>
</tr>
<tr>
<td>speed error, mean</td>
<td>m/s</td>
<td>1</td>
<td class="number">1.31</td>
<td class="number">1.03</td>
<td class="number">1.49</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity error (3-D), mean</td>
<td>m/s</td>
<td>-</td>
<td class="number">1.55</td>
<td class="number">1.27</td>
<td class="number">3.28</td>
<td class="number">5</td>
</tr>
<tr>
<td>outage epochs matched to the map</td>
<td>%</td>
<td>-</td>
<td class="number">100</td>
<td class="number">76.1</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<ul>
<li>horizontal position error, std: The point of a road pulls along it as well, which nothing measured: the sigma is too small.</li>
</ul>
<h3 id="lahrech-policy-paper-ours-mean-velocity-of-a-step-exact-projection-position-across-the-road-only"><a class="self" href="#lahrech-policy-paper-ours-mean-velocity-of-a-step-exact-projection-position-across-the-road-only">Lahrech, policy paper, ours: mean velocity of a step, exact projection, position across the road only</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>horizontal position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">1.67</td>
<td class="number">1.06</td>
<td class="number">6.01</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, mean</td>
<td>m</td>
<td>-</td>
<td class="number">3.50</td>
<td class="number">2.55</td>
<td class="number">6.24</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, max</td>
<td>m</td>
<td>-</td>
<td class="number">8.43</td>
<td class="number">5.84</td>
<td class="number">20.9</td>
<td class="number">5</td>
</tr>
<tr>
<td>filter's own sigma, rms</td>
<td>m</td>
<td>-</td>
<td class="number">4.42</td>
<td class="number">3.80</td>
<td class="number">6.29</td>
<td class="number">5</td>
</tr>
<tr>
<td>error over own sigma, rms</td>
<td></td>
<td>-</td>
<td class="number">0.794</td>
<td class="number">0.765</td>
<td class="number">1.49</td>
<td class="number">5</td>
</tr>
<tr>
<td>odometer alone, 10 % of the way, end of an outage</td>
<td>m</td>
<td>-</td>
<td class="number">6.50</td>
<td class="number">4.72</td>
<td class="number">9.99</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">3.10</td>
<td class="number">2.08</td>
<td class="number">5.83</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, mean</td>
<td>m</td>
<td>3.16</td>
<td class="number">5.20</td>
<td class="number">4.48</td>
<td class="number">9.81</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, max</td>
<td>m</td>
<td>7</td>
<td class="number">12.8</td>
<td class="number">11.1</td>
<td class="number">21.2</td>
<td class="number">5</td>
</tr>
<tr>
<td>speed error, mean</td>
<td>m/s</td>
<td>1</td>
<td class="number">0.895</td>
<td class="number">0.780</td>
<td class="number">1.19</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity error (3-D), mean</td>
<td>m/s</td>
<td>-</td>
<td class="number">1.15</td>
<td class="number">1.01</td>
<td class="number">1.67</td>
<td class="number">5</td>
</tr>
<tr>
<td>outage epochs matched to the map</td>
<td>%</td>
<td>-</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<ul>
<li>horizontal position error, std: 10 % of the way, taken as white, is what bounds it: the filter's own sigma says as much.</li>
</ul>
<h3 id="lahrech-policy-paper-map-of-points-every-5-m"><a class="self" href="#lahrech-policy-paper-map-of-points-every-5-m">Lahrech, policy paper, map of points every 5 m</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>horizontal position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">1.91</td>
<td class="number">1.29</td>
<td class="number">22.8</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, mean</td>
<td>m</td>
<td>-</td>
<td class="number">3.82</td>
<td class="number">2.22</td>
<td class="number">14.6</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, max</td>
<td>m</td>
<td>-</td>
<td class="number">7.68</td>
<td class="number">5.94</td>
<td class="number">88.9</td>
<td class="number">5</td>
</tr>
<tr>
<td>filter's own sigma, rms</td>
<td>m</td>
<td>-</td>
<td class="number">2.69</td>
<td class="number">2.55</td>
<td class="number">8.47</td>
<td class="number">5</td>
</tr>
<tr>
<td>error over own sigma, rms</td>
<td></td>
<td>-</td>
<td class="number">1.96</td>
<td class="number">0.976</td>
<td class="number">2.56</td>
<td class="number">5</td>
</tr>
<tr>
<td>odometer alone, 10 % of the way, end of an outage</td>
<td>m</td>
<td>-</td>
<td class="number">6.50</td>
<td class="number">4.72</td>
<td class="number">9.99</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">5.30</td>
<td class="number">2.30</td>
<td class="number">22.7</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, mean</td>
<td>m</td>
<td>3.16</td>
<td class="number">6.81</td>
<td class="number">4.24</td>
<td class="number">15.0</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, max</td>
<td>m</td>
<td>7</td>
<td class="number">20.4</td>
<td class="number">10.7</td>
<td class="number">89.1</td>
<td class="number">5</td>
</tr>
<tr>
<td>speed error, mean</td>
<td>m/s</td>
<td>1</td>
<td class="number">0.891</td>
<td class="number">0.778</td>
<td class="number">1.18</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity error (3-D), mean</td>
<td>m/s</td>
<td>-</td>
<td class="number">1.17</td>
<td class="number">1.01</td>
<td class="number">2.82</td>
<td class="number">5</td>
</tr>
<tr>
<td>outage epochs matched to the map</td>
<td>%</td>
<td>-</td>
<td class="number">100</td>
<td class="number">76.1</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<h3 id="lahrech-policy-always-doppler-velocity-calibrated-wheels"><a class="self" href="#lahrech-policy-always-doppler-velocity-calibrated-wheels">Lahrech, policy always: Doppler velocity, calibrated wheels</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>horizontal position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">2.20</td>
<td class="number">0.811</td>
<td class="number">5.60</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, mean</td>
<td>m</td>
<td>-</td>
<td class="number">3.74</td>
<td class="number">2.09</td>
<td class="number">4.75</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, max</td>
<td>m</td>
<td>-</td>
<td class="number">10.8</td>
<td class="number">4.41</td>
<td class="number">18.7</td>
<td class="number">5</td>
</tr>
<tr>
<td>filter's own sigma, rms</td>
<td>m</td>
<td>-</td>
<td class="number">4.42</td>
<td class="number">3.86</td>
<td class="number">6.91</td>
<td class="number">5</td>
</tr>
<tr>
<td>error over own sigma, rms</td>
<td></td>
<td>-</td>
<td class="number">0.855</td>
<td class="number">0.788</td>
<td class="number">1.30</td>
<td class="number">5</td>
</tr>
<tr>
<td>odometer alone, 10 % of the way, end of an outage</td>
<td>m</td>
<td>-</td>
<td class="number">6.50</td>
<td class="number">4.72</td>
<td class="number">9.99</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">3.25</td>
<td class="number">1.69</td>
<td class="number">5.54</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, mean</td>
<td>m</td>
<td>3.16</td>
<td class="number">5.06</td>
<td class="number">3.93</td>
<td class="number">7.75</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, max</td>
<td>m</td>
<td>7</td>
<td class="number">14.7</td>
<td class="number">10.2</td>
<td class="number">19.5</td>
<td class="number">5</td>
</tr>
<tr>
<td>speed error, mean</td>
<td>m/s</td>
<td>1</td>
<td class="number">0.924</td>
<td class="number">0.708</td>
<td class="number">1.17</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity error (3-D), mean</td>
<td>m/s</td>
<td>-</td>
<td class="number">1.17</td>
<td class="number">0.909</td>
<td class="number">1.54</td>
<td class="number">5</td>
</tr>
<tr>
<td>outage epochs matched to the map</td>
<td>%</td>
<td>-</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<h3 id="lahrech-policy-paper-terrain-as-altitude"><a class="self" href="#lahrech-policy-paper-terrain-as-altitude">Lahrech, policy paper, terrain as altitude</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>horizontal position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">1.67</td>
<td class="number">1.06</td>
<td class="number">6.01</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, mean</td>
<td>m</td>
<td>-</td>
<td class="number">3.50</td>
<td class="number">2.55</td>
<td class="number">6.24</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, max</td>
<td>m</td>
<td>-</td>
<td class="number">8.43</td>
<td class="number">5.84</td>
<td class="number">20.9</td>
<td class="number">5</td>
</tr>
<tr>
<td>filter's own sigma, rms</td>
<td>m</td>
<td>-</td>
<td class="number">4.42</td>
<td class="number">3.80</td>
<td class="number">6.29</td>
<td class="number">5</td>
</tr>
<tr>
<td>error over own sigma, rms</td>
<td></td>
<td>-</td>
<td class="number">0.794</td>
<td class="number">0.765</td>
<td class="number">1.49</td>
<td class="number">5</td>
</tr>
<tr>
<td>odometer alone, 10 % of the way, end of an outage</td>
<td>m</td>
<td>-</td>
<td class="number">6.50</td>
<td class="number">4.72</td>
<td class="number">9.99</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">3.46</td>
<td class="number">1.75</td>
<td class="number">5.27</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, mean</td>
<td>m</td>
<td>3.16</td>
<td class="number">6.03</td>
<td class="number">4.13</td>
<td class="number">7.89</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, max</td>
<td>m</td>
<td>7</td>
<td class="number">12.8</td>
<td class="number">9.84</td>
<td class="number">21.3</td>
<td class="number">5</td>
</tr>
<tr>
<td>speed error, mean</td>
<td>m/s</td>
<td>1</td>
<td class="number">0.895</td>
<td class="number">0.780</td>
<td class="number">1.19</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity error (3-D), mean</td>
<td>m/s</td>
<td>-</td>
<td class="number">1.16</td>
<td class="number">1.07</td>
<td class="number">1.72</td>
<td class="number">5</td>
</tr>
<tr>
<td>outage epochs matched to the map</td>
<td>%</td>
<td>-</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<ul>
<li>horizontal position error, std: The town is hilly and Calais flat; its raster errs by as much as an open loop of 40 s drifts.</li>
</ul>
<h3 id="lahrech-policy-paper-ordinary-wheels-radii-03--slip-02--96-ticks"><a class="self" href="#lahrech-policy-paper-ordinary-wheels-radii-03--slip-02--96-ticks">Lahrech, policy paper, ordinary wheels (radii 0.3 %, slip 0.2 %, 96 ticks)</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>horizontal position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">0.396</td>
<td class="number">0.316</td>
<td class="number">0.817</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, mean</td>
<td>m</td>
<td>-</td>
<td class="number">1.77</td>
<td class="number">1.39</td>
<td class="number">2.14</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, max</td>
<td>m</td>
<td>-</td>
<td class="number">2.29</td>
<td class="number">2.08</td>
<td class="number">4.61</td>
<td class="number">5</td>
</tr>
<tr>
<td>filter's own sigma, rms</td>
<td>m</td>
<td>-</td>
<td class="number">4.29</td>
<td class="number">3.84</td>
<td class="number">6.24</td>
<td class="number">5</td>
</tr>
<tr>
<td>error over own sigma, rms</td>
<td></td>
<td>-</td>
<td class="number">0.479</td>
<td class="number">0.300</td>
<td class="number">0.743</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">1.58</td>
<td class="number">0.893</td>
<td class="number">5.68</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, mean</td>
<td>m</td>
<td>3.16</td>
<td class="number">3.94</td>
<td class="number">2.61</td>
<td class="number">9.48</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, max</td>
<td>m</td>
<td>7</td>
<td class="number">9.82</td>
<td class="number">4.55</td>
<td class="number">20.5</td>
<td class="number">5</td>
</tr>
<tr>
<td>speed error, mean</td>
<td>m/s</td>
<td>1</td>
<td class="number">0.212</td>
<td class="number">0.150</td>
<td class="number">0.253</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity error (3-D), mean</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.451</td>
<td class="number">0.300</td>
<td class="number">0.643</td>
<td class="number">5</td>
</tr>
<tr>
<td>outage epochs matched to the map</td>
<td>%</td>
<td>-</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<h3 id="lahrech-as-printed-ordinary-wheels"><a class="self" href="#lahrech-as-printed-ordinary-wheels">Lahrech, as printed, ordinary wheels</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>horizontal position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">0.936</td>
<td class="number">0.390</td>
<td class="number">1.12</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, mean</td>
<td>m</td>
<td>-</td>
<td class="number">1.88</td>
<td class="number">1.73</td>
<td class="number">2.86</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, max</td>
<td>m</td>
<td>-</td>
<td class="number">3.99</td>
<td class="number">3.03</td>
<td class="number">4.89</td>
<td class="number">5</td>
</tr>
<tr>
<td>filter's own sigma, rms</td>
<td>m</td>
<td>-</td>
<td class="number">2.64</td>
<td class="number">2.51</td>
<td class="number">3.21</td>
<td class="number">5</td>
</tr>
<tr>
<td>error over own sigma, rms</td>
<td></td>
<td>-</td>
<td class="number">0.875</td>
<td class="number">0.688</td>
<td class="number">1.43</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">1.84</td>
<td class="number">0.685</td>
<td class="number">5.61</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, mean</td>
<td>m</td>
<td>3.16</td>
<td class="number">4.35</td>
<td class="number">3.01</td>
<td class="number">9.55</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, max</td>
<td>m</td>
<td>7</td>
<td class="number">10.1</td>
<td class="number">4.26</td>
<td class="number">20.6</td>
<td class="number">5</td>
</tr>
<tr>
<td>speed error, mean</td>
<td>m/s</td>
<td>1</td>
<td class="number">0.531</td>
<td class="number">0.403</td>
<td class="number">0.752</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity error (3-D), mean</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.785</td>
<td class="number">0.593</td>
<td class="number">0.919</td>
<td class="number">5</td>
</tr>
<tr>
<td>outage epochs matched to the map</td>
<td>%</td>
<td>-</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<h3 id="lahrech-policy-always-ordinary-wheels-given-as-2--by-the-option-wheel_error_share"><a class="self" href="#lahrech-policy-always-ordinary-wheels-given-as-2--by-the-option-wheel_error_share">Lahrech, policy always, ordinary wheels, given as 2 % by the option wheel_error_share</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>horizontal position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">0.499</td>
<td class="number">0.353</td>
<td class="number">0.622</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, mean</td>
<td>m</td>
<td>-</td>
<td class="number">1.59</td>
<td class="number">1.45</td>
<td class="number">1.85</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, max</td>
<td>m</td>
<td>-</td>
<td class="number">2.43</td>
<td class="number">2.08</td>
<td class="number">3.75</td>
<td class="number">5</td>
</tr>
<tr>
<td>filter's own sigma, rms</td>
<td>m</td>
<td>-</td>
<td class="number">2.25</td>
<td class="number">2.18</td>
<td class="number">3.13</td>
<td class="number">5</td>
</tr>
<tr>
<td>error over own sigma, rms</td>
<td></td>
<td>-</td>
<td class="number">0.796</td>
<td class="number">0.675</td>
<td class="number">1.05</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">1.58</td>
<td class="number">0.479</td>
<td class="number">3.26</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, mean</td>
<td>m</td>
<td>3.16</td>
<td class="number">3.31</td>
<td class="number">2.15</td>
<td class="number">7.60</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, max</td>
<td>m</td>
<td>7</td>
<td class="number">6.65</td>
<td class="number">3.28</td>
<td class="number">15.3</td>
<td class="number">5</td>
</tr>
<tr>
<td>speed error, mean</td>
<td>m/s</td>
<td>1</td>
<td class="number">0.0990</td>
<td class="number">0.0694</td>
<td class="number">0.104</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity error (3-D), mean</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.268</td>
<td class="number">0.197</td>
<td class="number">0.318</td>
<td class="number">5</td>
</tr>
<tr>
<td>outage epochs matched to the map</td>
<td>%</td>
<td>-</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<h3 id="lahrech-policy-paper-a-speed-signal-scale-1--and-a-gyroscope-in-the-wheels-place"><a class="self" href="#lahrech-policy-paper-a-speed-signal-scale-1--and-a-gyroscope-in-the-wheels-place">Lahrech, policy paper, a speed signal (scale 1 %) and a gyroscope in the wheels' place</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>horizontal position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">0.379</td>
<td class="number">0.314</td>
<td class="number">0.730</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, mean</td>
<td>m</td>
<td>-</td>
<td class="number">1.65</td>
<td class="number">1.45</td>
<td class="number">1.95</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, max</td>
<td>m</td>
<td>-</td>
<td class="number">2.30</td>
<td class="number">2.12</td>
<td class="number">4.46</td>
<td class="number">5</td>
</tr>
<tr>
<td>filter's own sigma, rms</td>
<td>m</td>
<td>-</td>
<td class="number">4.27</td>
<td class="number">3.82</td>
<td class="number">6.23</td>
<td class="number">5</td>
</tr>
<tr>
<td>error over own sigma, rms</td>
<td></td>
<td>-</td>
<td class="number">0.507</td>
<td class="number">0.343</td>
<td class="number">0.751</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">1.57</td>
<td class="number">0.770</td>
<td class="number">5.68</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, mean</td>
<td>m</td>
<td>3.16</td>
<td class="number">3.82</td>
<td class="number">2.87</td>
<td class="number">9.49</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, max</td>
<td>m</td>
<td>7</td>
<td class="number">9.77</td>
<td class="number">4.39</td>
<td class="number">20.6</td>
<td class="number">5</td>
</tr>
<tr>
<td>speed error, mean</td>
<td>m/s</td>
<td>1</td>
<td class="number">0.185</td>
<td class="number">0.124</td>
<td class="number">0.230</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity error (3-D), mean</td>
<td>m/s</td>
<td>-</td>
<td class="number">0.337</td>
<td class="number">0.187</td>
<td class="number">0.411</td>
<td class="number">5</td>
</tr>
<tr>
<td>outage epochs matched to the map</td>
<td>%</td>
<td>-</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<h3 id="lahrech-policy-paper-a-speed-signal-alone"><a class="self" href="#lahrech-policy-paper-a-speed-signal-alone">Lahrech, policy paper, a speed signal alone</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>horizontal position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">63.8</td>
<td class="number">0.389</td>
<td class="number">127</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, mean</td>
<td>m</td>
<td>-</td>
<td class="number">29.4</td>
<td class="number">1.66</td>
<td class="number">146</td>
<td class="number">5</td>
</tr>
<tr>
<td>horizontal position error, max</td>
<td>m</td>
<td>-</td>
<td class="number">264</td>
<td class="number">2.06</td>
<td class="number">370</td>
<td class="number">5</td>
</tr>
<tr>
<td>filter's own sigma, rms</td>
<td>m</td>
<td>-</td>
<td class="number">49.3</td>
<td class="number">5.22</td>
<td class="number">137</td>
<td class="number">5</td>
</tr>
<tr>
<td>error over own sigma, rms</td>
<td></td>
<td>-</td>
<td class="number">2.26</td>
<td class="number">0.337</td>
<td class="number">17.8</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, std</td>
<td>m</td>
<td>1.25</td>
<td class="number">63.3</td>
<td class="number">1.60</td>
<td class="number">127</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, mean</td>
<td>m</td>
<td>3.16</td>
<td class="number">30.6</td>
<td class="number">4.06</td>
<td class="number">146</td>
<td class="number">5</td>
</tr>
<tr>
<td>3-D position error, max</td>
<td>m</td>
<td>7</td>
<td class="number">264</td>
<td class="number">9.77</td>
<td class="number">370</td>
<td class="number">5</td>
</tr>
<tr>
<td>speed error, mean</td>
<td>m/s</td>
<td>1</td>
<td class="number">0.0994</td>
<td class="number">0.0614</td>
<td class="number">0.176</td>
<td class="number">5</td>
</tr>
<tr>
<td>velocity error (3-D), mean</td>
<td>m/s</td>
<td>-</td>
<td class="number">3.46</td>
<td class="number">0.219</td>
<td class="number">10.9</td>
<td class="number">5</td>
</tr>
<tr>
<td>outage epochs matched to the map</td>
<td>%</td>
<td>-</td>
<td class="number">80.3</td>
<td class="number">26.8</td>
<td class="number">100</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<ul>
<li>horizontal position error, std: Nothing feels turns: at a junction the estimate goes straight on, and the sigma does not know it.</li>
</ul>
<h2 id="saadaoui-2011-position-speed-and-heading"><a class="self" href="#saadaoui-2011-position-speed-and-heading">Saadaoui 2011: position, speed and heading</a></h2>
<p>A drive of 150 s at one epoch a second, GPS noise of 15 m per axis, speed and heading from an INS, as <code>benchmarks/experiments/saadaoui.py</code> describes. The filters are corrected where the thesis prints what cannot work; what the printed forms do is the
last table.</p>
<h3 id="saadaoui-2011-constant-heading-figures-41-42-47"><a class="self" href="#saadaoui-2011-constant-heading-figures-41-42-47">Saadaoui 2011, constant heading (figures 4.1, 4.2, 4.7)</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>GPS alone, mean error</td>
<td>m</td>
<td>about 18</td>
<td class="number">18.7</td>
<td class="number">17.4</td>
<td class="number">20.1</td>
<td class="number">5</td>
</tr>
<tr>
<td>GPS alone, largest error on an axis</td>
<td>m</td>
<td>up to 30</td>
<td class="number">44.8</td>
<td class="number">40.8</td>
<td class="number">50.5</td>
<td class="number">5</td>
</tr>
<tr>
<td>KF, mean error</td>
<td>m</td>
<td>4 to 5</td>
<td class="number">3.53</td>
<td class="number">2.14</td>
<td class="number">4.27</td>
<td class="number">5</td>
</tr>
<tr>
<td>KF, largest error on an axis</td>
<td>m</td>
<td>peaks of 7</td>
<td class="number">6.16</td>
<td class="number">5.21</td>
<td class="number">7.84</td>
<td class="number">5</td>
</tr>
<tr>
<td>KF over GPS alone, mean error</td>
<td></td>
<td>4 to 5 of 18</td>
<td class="number">0.189</td>
<td class="number">0.114</td>
<td class="number">0.235</td>
<td class="number">5</td>
</tr>
<tr>
<td>EKF from KF, largest difference</td>
<td>m</td>
<td>almost equal</td>
<td class="number">0</td>
<td class="number">0</td>
<td class="number">0</td>
<td class="number">5</td>
</tr>
<tr>
<td>UKF from KF, largest difference</td>
<td>m</td>
<td>almost equal</td>
<td class="number">8.2e-10</td>
<td class="number">4.9e-10</td>
<td class="number">1.1e-09</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<ul>
<li>GPS alone, largest error on an axis: Gaussian noise of 15 m has its mean in the plane at 18.8 m, and a largest value beyond the published one.</li>
</ul>
<h3 id="saadaoui-2011-turning-figures-43-to-46-48"><a class="self" href="#saadaoui-2011-turning-figures-43-to-46-48">Saadaoui 2011, turning (figures 4.3 to 4.6, 4.8)</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>GPS alone, mean error</td>
<td>m</td>
<td>about 18</td>
<td class="number">18.8</td>
<td class="number">18.3</td>
<td class="number">20.1</td>
<td class="number">5</td>
</tr>
<tr>
<td>GPS alone, largest error on an axis</td>
<td>m</td>
<td>up to 35</td>
<td class="number">50.0</td>
<td class="number">45.4</td>
<td class="number">53.8</td>
<td class="number">5</td>
</tr>
<tr>
<td>KF (heading as command), mean error</td>
<td>m</td>
<td>-</td>
<td class="number">2.84</td>
<td class="number">2.04</td>
<td class="number">3.41</td>
<td class="number">5</td>
</tr>
<tr>
<td>EKF, mean error</td>
<td>m</td>
<td>-</td>
<td class="number">2.68</td>
<td class="number">2.17</td>
<td class="number">3.56</td>
<td class="number">5</td>
</tr>
<tr>
<td>EKF, largest error on an axis</td>
<td>m</td>
<td>does not exceed 10</td>
<td class="number">5.22</td>
<td class="number">4.44</td>
<td class="number">9.75</td>
<td class="number">5</td>
</tr>
<tr>
<td>EKF over GPS alone, mean error</td>
<td></td>
<td>1/3 to 1/2</td>
<td class="number">0.138</td>
<td class="number">0.116</td>
<td class="number">0.189</td>
<td class="number">5</td>
</tr>
<tr>
<td>UKF, mean error</td>
<td>m</td>
<td>-</td>
<td class="number">2.64</td>
<td class="number">2.12</td>
<td class="number">3.61</td>
<td class="number">5</td>
</tr>
<tr>
<td>UKF, largest error on an axis</td>
<td>m</td>
<td>generally up to 10</td>
<td class="number">5.08</td>
<td class="number">4.56</td>
<td class="number">9.70</td>
<td class="number">5</td>
</tr>
<tr>
<td>UKF over GPS alone, mean error</td>
<td></td>
<td>-</td>
<td class="number">0.136</td>
<td class="number">0.113</td>
<td class="number">0.192</td>
<td class="number">5</td>
</tr>
<tr>
<td>EKF minus UKF, mean error</td>
<td>cm</td>
<td>centimetres, EKF better</td>
<td class="number">3.60</td>
<td class="number">-5.80</td>
<td class="number">5.24</td>
<td class="number">5</td>
</tr>
<tr>
<td>EKF from UKF, largest distance</td>
<td>m</td>
<td>a metre or less</td>
<td class="number">0.143</td>
<td class="number">0.132</td>
<td class="number">0.149</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<ul>
<li>GPS alone, largest error on an axis: Gaussian noise of 15 m has its mean in the plane at 18.8 m, and a largest value beyond the published one.</li>
<li>EKF minus UKF, mean error: Its sign depends on the drive; the thesis shows one.</li>
</ul>
<h3 id="saadaoui-2011-turning-40-s-without-gps-ours-the-thesis-has-no-outage"><a class="self" href="#saadaoui-2011-turning-40-s-without-gps-ours-the-thesis-has-no-outage">Saadaoui 2011, turning, 40 s without GPS (ours; the thesis has no outage)</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>quantity</th>
<th>unit</th>
<th>published</th>
<th class="number">ours: median</th>
<th class="number">least</th>
<th class="number">most</th>
<th class="number">seeds</th>
</tr>
</thead>
<tbody>
<tr>
<td>KF, error at its end</td>
<td>m</td>
<td>-</td>
<td class="number">2.91</td>
<td class="number">0.817</td>
<td class="number">6.23</td>
<td class="number">5</td>
</tr>
<tr>
<td>KF, stated sigma at its end</td>
<td>m</td>
<td>-</td>
<td class="number">5.91</td>
<td class="number">5.91</td>
<td class="number">5.91</td>
<td class="number">5</td>
</tr>
<tr>
<td>EKF, error at its end</td>
<td>m</td>
<td>-</td>
<td class="number">4.53</td>
<td class="number">1.19</td>
<td class="number">5.67</td>
<td class="number">5</td>
</tr>
<tr>
<td>EKF, stated sigma at its end</td>
<td>m</td>
<td>-</td>
<td class="number">7.10</td>
<td class="number">6.77</td>
<td class="number">7.29</td>
<td class="number">5</td>
</tr>
<tr>
<td>UKF, error at its end</td>
<td>m</td>
<td>-</td>
<td class="number">4.33</td>
<td class="number">0.973</td>
<td class="number">6.00</td>
<td class="number">5</td>
</tr>
<tr>
<td>UKF, stated sigma at its end</td>
<td>m</td>
<td>-</td>
<td class="number">7.10</td>
<td class="number">6.77</td>
<td class="number">7.29</td>
<td class="number">5</td>
</tr>
<tr>
<td>way driven in it</td>
<td>m</td>
<td>-</td>
<td class="number">1128</td>
<td class="number">874</td>
<td class="number">1206</td>
<td class="number">5</td>
</tr>
</tbody>
</table></div>
<h3 id="saadaoui-2011-turning-the-printed-forms-ours-the-thesis-reports-no-such-errors"><a class="self" href="#saadaoui-2011-turning-the-printed-forms-ours-the-thesis-reports-no-such-errors">Saadaoui 2011, turning, the printed forms (ours; the thesis reports no such errors)</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th></th>
<th class="number">mean error, m</th>
</tr>
</thead>
<tbody>
<tr>
<td>KF, command u = [v, heading]</td>
<td class="number">982 (279 to 1420)</td>
</tr>
<tr>
<td>EKF, innovation without Z</td>
<td class="number">50827 (46097 to 105626)</td>
</tr>
<tr>
<td>EKF, heading from the fixes alone</td>
<td class="number">7.67 (6.95 to 9.73)</td>
</tr>
<tr>
<td>the same, printed Jacobian</td>
<td class="number">363 (22.3 to 932)</td>
</tr>
<tr>
<td>EKF, heading overwritten, printed Jacobian</td>
<td class="number">2.82 (2.20 to 3.54)</td>
</tr>
<tr>
<td>EKF, heading overwritten, variance kept</td>
<td class="number">5.73 (5.10 to 6.55)</td>
</tr>
<tr>
<td>UKF, heading from the fixes alone</td>
<td class="number">7.54 (6.07 to 8.48)</td>
</tr>
<tr>
<td>the same, alpha = 1e3</td>
<td class="number">596 (287 to 694)</td>
</tr>
<tr>
<td>UKF, heading measured, alpha = 1e3</td>
<td class="number">2.95 (1.93 to 3.30)</td>
</tr>
<tr>
<td>UKF, heading measured, points not redrawn</td>
<td class="number">4.08 (3.46 to 5.61)</td>
</tr>
<tr>
<td>UKF, heading overwritten, variance kept</td>
<td class="number">6.87 (5.80 to 8.65)</td>
</tr>
</tbody>
</table></div>
<h2 id="every-method-on-surveyed-roads"><a class="self" href="#every-method-on-surveyed-roads">Every method on surveyed roads</a></h2>
<p>Karlsruhe 09 (hilly, 1.7 km) and 10 (0.9 km) with receiver profile m8, one drive a seed, every method with its defaults: root mean square error of the slopes in percent of slope, share of the truth's segments that got a slope, share of errors within
1.96 of the stated sigmas, and seconds per drive, reading the log included. Spreads over the seeds stand in brackets. Times are of one machine with two cores; compare them with each other.</p>
<h3 id="methods-on-karlsruhe-09"><a class="self" href="#methods-on-karlsruhe-09">Methods on karlsruhe 09</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th></th>
<th class="number">RMSE, %</th>
<th class="number">coverage, %</th>
<th class="number">within 1.96 sigma, %</th>
<th class="number">time, s</th>
</tr>
</thead>
<tbody>
<tr>
<td>profile</td>
<td class="number">0.511 (0.483 to 0.576)</td>
<td class="number">100</td>
<td class="number">96.9 (95.3 to 98.4)</td>
<td class="number">0.125 (0.122 to 1.10)</td>
</tr>
<tr>
<td>particle</td>
<td class="number">0.696 (0.613 to 0.833)</td>
<td class="number">34.4 (25.0 to 40.6)</td>
<td class="number">96.2 (94.1 to 100)</td>
<td class="number">0.704 (0.614 to 0.723)</td>
</tr>
<tr>
<td>odometer-map</td>
<td class="number">2.97 (2.65 to 3.68)</td>
<td class="number">35.9 (26.6 to 40.6)</td>
<td class="number">94.4 (87.0 to 100)</td>
<td class="number">0.0391 (0.0335 to 0.0541)</td>
</tr>
<tr>
<td>ukf-dem</td>
<td class="number">2.52 (2.05 to 2.91)</td>
<td class="number">39.1 (23.4 to 40.6)</td>
<td class="number">96.2 (93.3 to 100)</td>
<td class="number">0.0701 (0.0634 to 0.0723)</td>
</tr>
<tr>
<td>raw</td>
<td class="number">2.61 (1.73 to 3.79)</td>
<td class="number">12.5 (10.9 to 14.1)</td>
<td class="number">100</td>
<td class="number">0.0120 (0.0120 to 0.0187)</td>
</tr>
<tr>
<td>dem</td>
<td class="number">5.56 (5.48 to 5.56)</td>
<td class="number">100 (98.4 to 100)</td>
<td class="number">84.4 (84.4 to 85.7)</td>
<td class="number">0.0136 (0.0132 to 0.0141)</td>
</tr>
<tr>
<td>gps-ins-kf</td>
<td class="number">0.487 (0.403 to 0.642)</td>
<td class="number">34.4 (25.0 to 39.1)</td>
<td class="number">100 (94.1 to 100)</td>
<td class="number">0.0241 (0.0231 to 0.0253)</td>
</tr>
<tr>
<td>gps-ins-ekf</td>
<td class="number">0.488 (0.404 to 0.642)</td>
<td class="number">34.4 (25.0 to 39.1)</td>
<td class="number">100 (94.1 to 100)</td>
<td class="number">0.0272 (0.0249 to 0.0278)</td>
</tr>
<tr>
<td>gps-ins-ukf</td>
<td class="number">0.506 (0.403 to 0.640)</td>
<td class="number">34.4 (23.4 to 39.1)</td>
<td class="number">100 (94.1 to 100)</td>
<td class="number">0.0475 (0.0436 to 0.0488)</td>
</tr>
</tbody>
</table></div>
<h3 id="methods-on-karlsruhe-09-40-s-without-gnss"><a class="self" href="#methods-on-karlsruhe-09-40-s-without-gnss">Methods on karlsruhe 09, 40 s without GNSS</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th></th>
<th class="number">RMSE, %</th>
<th class="number">coverage, %</th>
<th class="number">within 1.96 sigma, %</th>
<th class="number">time, s</th>
</tr>
</thead>
<tbody>
<tr>
<td>profile</td>
<td class="number">0.592 (0.483 to 0.700)</td>
<td class="number">100</td>
<td class="number">96.9 (95.3 to 100)</td>
<td class="number">0.128 (0.125 to 0.131)</td>
</tr>
<tr>
<td>particle</td>
<td class="number">0.835 (0.721 to 0.907)</td>
<td class="number">34.4 (25.0 to 35.9)</td>
<td class="number">95.7 (87.5 to 100)</td>
<td class="number">0.705 (0.640 to 0.741)</td>
</tr>
<tr>
<td>odometer-map</td>
<td class="number">3.56 (2.82 to 4.28)</td>
<td class="number">29.7 (23.4 to 34.4)</td>
<td class="number">95.2 (87.5 to 100)</td>
<td class="number">0.0380 (0.0352 to 0.0391)</td>
</tr>
<tr>
<td>ukf-dem</td>
<td class="number">3.08 (2.28 to 3.83)</td>
<td class="number">35.9 (18.8 to 35.9)</td>
<td class="number">95.7 (91.7 to 100)</td>
<td class="number">0.0648 (0.0579 to 0.0665)</td>
</tr>
<tr>
<td>raw</td>
<td class="number">2.86 (1.20 to 3.21)</td>
<td class="number">7.81 (7.81 to 9.38)</td>
<td class="number">100</td>
<td class="number">0.0130 (0.0126 to 0.0142)</td>
</tr>
<tr>
<td>dem</td>
<td class="number">6.11 (6.00 to 6.20)</td>
<td class="number">78.1 (75.0 to 79.7)</td>
<td class="number">80.0 (79.2 to 82.0)</td>
<td class="number">0.0134 (0.0131 to 0.0137)</td>
</tr>
<tr>
<td>gps-ins-kf</td>
<td class="number">0.493 (0.483 to 0.665)</td>
<td class="number">35.9 (25.0 to 37.5)</td>
<td class="number">100 (88.2 to 100)</td>
<td class="number">0.0239 (0.0223 to 0.0241)</td>
</tr>
<tr>
<td>gps-ins-ekf</td>
<td class="number">0.493 (0.484 to 0.673)</td>
<td class="number">34.4 (25.0 to 37.5)</td>
<td class="number">100 (88.2 to 100)</td>
<td class="number">0.0263 (0.0243 to 0.0268)</td>
</tr>
<tr>
<td>gps-ins-ukf</td>
<td class="number">0.493 (0.472 to 0.672)</td>
<td class="number">34.4 (23.4 to 37.5)</td>
<td class="number">100 (88.2 to 100)</td>
<td class="number">0.0454 (0.0419 to 0.0461)</td>
</tr>
</tbody>
</table></div>
<h3 id="methods-on-karlsruhe-10"><a class="self" href="#methods-on-karlsruhe-10">Methods on karlsruhe 10</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th></th>
<th class="number">RMSE, %</th>
<th class="number">coverage, %</th>
<th class="number">within 1.96 sigma, %</th>
<th class="number">time, s</th>
</tr>
</thead>
<tbody>
<tr>
<td>profile</td>
<td class="number">0.664 (0.568 to 0.762)</td>
<td class="number">100</td>
<td class="number">92.3 (92.3 to 96.2)</td>
<td class="number">0.0873 (0.0859 to 0.0980)</td>
</tr>
<tr>
<td>particle</td>
<td class="number">0.889 (0.639 to 1.35)</td>
<td class="number">76.9 (65.4 to 76.9)</td>
<td class="number">95.0 (83.3 to 100)</td>
<td class="number">0.533 (0.466 to 0.542)</td>
</tr>
<tr>
<td>odometer-map</td>
<td class="number">4.72 (2.86 to 5.19)</td>
<td class="number">73.1 (69.2 to 73.1)</td>
<td class="number">94.7 (88.9 to 100)</td>
<td class="number">0.0272 (0.0254 to 0.0273)</td>
</tr>
<tr>
<td>ukf-dem</td>
<td class="number">3.57 (2.42 to 3.79)</td>
<td class="number">76.9 (69.2 to 76.9)</td>
<td class="number">95.0 (90.0 to 100)</td>
<td class="number">0.0542 (0.0501 to 0.0550)</td>
</tr>
<tr>
<td>raw</td>
<td class="number">3.34 (3.12 to 5.37)</td>
<td class="number">53.8 (50.0 to 57.7)</td>
<td class="number">100 (92.9 to 100)</td>
<td class="number">0.0130 (0.0126 to 0.0136)</td>
</tr>
<tr>
<td>dem</td>
<td class="number">4.63</td>
<td class="number">100</td>
<td class="number">88.5</td>
<td class="number">0.0125 (0.0123 to 0.0130)</td>
</tr>
<tr>
<td>gps-ins-kf</td>
<td class="number">0.776 (0.458 to 0.787)</td>
<td class="number">76.9 (69.2 to 80.8)</td>
<td class="number">90.5 (88.9 to 100)</td>
<td class="number">0.0217 (0.0205 to 0.0221)</td>
</tr>
<tr>
<td>gps-ins-ekf</td>
<td class="number">0.766 (0.458 to 0.789)</td>
<td class="number">73.1 (69.2 to 80.8)</td>
<td class="number">90.5 (88.9 to 100)</td>
<td class="number">0.0235 (0.0224 to 0.0265)</td>
</tr>
<tr>
<td>gps-ins-ukf</td>
<td class="number">0.763 (0.459 to 0.793)</td>
<td class="number">73.1 (69.2 to 76.9)</td>
<td class="number">90.0 (88.9 to 100)</td>
<td class="number">0.0398 (0.0369 to 0.0401)</td>
</tr>
</tbody>
</table></div>
<h3 id="methods-on-karlsruhe-10-40-s-without-gnss"><a class="self" href="#methods-on-karlsruhe-10-40-s-without-gnss">Methods on karlsruhe 10, 40 s without GNSS</a></h3>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th></th>
<th class="number">RMSE, %</th>
<th class="number">coverage, %</th>
<th class="number">within 1.96 sigma, %</th>
<th class="number">time, s</th>
</tr>
</thead>
<tbody>
<tr>
<td>profile</td>
<td class="number">0.772 (0.719 to 1.04)</td>
<td class="number">100</td>
<td class="number">92.3 (88.5 to 100)</td>
<td class="number">0.0924 (0.0912 to 0.0931)</td>
</tr>
<tr>
<td>particle</td>
<td class="number">0.930 (0.847 to 1.45)</td>
<td class="number">69.2 (57.7 to 73.1)</td>
<td class="number">93.3 (72.2 to 94.7)</td>
<td class="number">0.543 (0.487 to 0.569)</td>
</tr>
<tr>
<td>odometer-map</td>
<td class="number">3.10 (1.61 to 4.45)</td>
<td class="number">53.8 (46.2 to 57.7)</td>
<td class="number">100 (91.7 to 100)</td>
<td class="number">0.0332 (0.0318 to 0.0339)</td>
</tr>
<tr>
<td>ukf-dem</td>
<td class="number">3.04 (2.76 to 6.45)</td>
<td class="number">61.5 (46.2 to 76.9)</td>
<td class="number">95.0 (75.0 to 100)</td>
<td class="number">0.0511 (0.0472 to 0.0544)</td>
</tr>
<tr>
<td>raw</td>
<td class="number">3.48 (2.38 to 4.07)</td>
<td class="number">42.3 (30.8 to 46.2)</td>
<td class="number">100</td>
<td class="number">0.0132 (0.0129 to 0.0144)</td>
</tr>
<tr>
<td>dem</td>
<td class="number">4.11 (3.60 to 4.47)</td>
<td class="number">69.2 (65.4 to 73.1)</td>
<td class="number">89.5 (88.9 to 94.1)</td>
<td class="number">0.0132 (0.0129 to 0.0178)</td>
</tr>
<tr>
<td>gps-ins-kf</td>
<td class="number">0.853 (0.690 to 0.969)</td>
<td class="number">76.9 (69.2 to 80.8)</td>
<td class="number">88.9 (80.0 to 94.4)</td>
<td class="number">0.0215 (0.0202 to 0.0217)</td>
</tr>
<tr>
<td>gps-ins-ekf</td>
<td class="number">0.853 (0.690 to 0.969)</td>
<td class="number">76.9 (69.2 to 80.8)</td>
<td class="number">88.9 (80.0 to 94.4)</td>
<td class="number">0.0235 (0.0223 to 0.0237)</td>
</tr>
<tr>
<td>gps-ins-ukf</td>
<td class="number">0.860 (0.689 to 0.967)</td>
<td class="number">76.9 (69.2 to 80.8)</td>
<td class="number">88.9 (80.0 to 94.4)</td>
<td class="number">0.0369 (0.0339 to 0.0389)</td>
</tr>
</tbody>
</table></div>
<p>What makes the differences:</p>
<ul>
<li>Coverage: all but <code>profile</code> and <code>dem</code> draw a line through the epochs on a segment and need three of them (<code>raw</code> four) over five metres at least; at 1 Hz a third of sequence 09's segments, half of which are shorter than 21 m, has them. <code>profile</code>
estimates heights along the whole path, <code>dem</code> takes the elevation model's at a segment's ends. An error over a third of the segments is not that of the harder rest: compare RMSE where coverage is alike.</li>
<li><code>raw</code> takes altitudes as the receiver logs them, which wander by metres; <code>dem</code> sees the surface at 90 m from post to post, trees and cuttings averaged.</li>
<li><code>odometer-map</code> and <code>ukf-dem</code> follow their documents, which have neither pitch nor Doppler velocity: their climb comes from heights alone. <code>gps-ins-*</code> and <code>particle</code> use both.</li>
<li><code>particle</code> errs by more than <code>gps-ins-*</code> at the same coverage because its position row is the printed one, without a dt^2/2: with <code>--option discretisation=exact</code> the error over both sequences, 0.84 %, is 0.64 % (with <code>filter=ekf</code>, <code>slope_accuracy.py</code>).
Leaving the terrain out changes nothing. Its time is that of 100,000 particles at one epoch a second.</li>
<li>The cut drives lose 40 of 165 s and of 124 s. What is estimated there rests on the other sensors; the share within 1.96 sigma says how truly the sigmas grow.</li>
</ul>
`;export{e as default};