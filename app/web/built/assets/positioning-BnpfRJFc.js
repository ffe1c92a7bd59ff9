var e=`<h1 id="positions-from-raw-pseudoranges">Positions from raw pseudoranges</h1>
<p>Between high houses a receiver's own position is tens of metres off, because reflected signals are taken at face value. A log that holds what the receiver measured (pseudorange, Doppler, C/N0 of each satellite) can be positioned anew.
This page says which solver is for which log, what each reaches, and what slopes gain from it. The thesis is N. Viandier, <em>Modélisation et utilisation des erreurs de pseudodistances GNSS en environnement transport</em> (2011).
&quot;Notes 6&quot;, which options and comments name as a source, is this project's own earlier study of pseudoranges: it fixed the one-sided law, weights and noises before any solver here was run.</p>
<h2 id="what-to-record-and-how-to-hand-it-in"><a class="self" href="#what-to-record-and-how-to-hand-it-in">What to record, and how to hand it in</a></h2>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>log</th>
<th>holds</th>
<th>needs beside it</th>
</tr>
</thead>
<tbody>
<tr>
<td>u-blox <code>.ubx</code> with RXM-RAWX and RXM-SFRBX</td>
<td>measurements and the satellites' messages</td>
<td>nothing, once each satellite was heard for half a minute</td>
</tr>
<tr>
<td>u-blox <code>.ubx</code> with RXM-RAWX alone</td>
<td>measurements</td>
<td>a RINEX navigation file of that day</td>
</tr>
<tr>
<td>RINEX observations (2.11, 3, 4, also compact)</td>
<td>measurements</td>
<td>navigation files of that day (several, or a mixed one)</td>
</tr>
<tr>
<td>Android GnssLogger text</td>
<td><code>Raw</code> lines, and the phone's own fixes</td>
<td>a RINEX navigation file of that day</td>
</tr>
<tr>
<td>CSV of pseudoranges</td>
<td><code>time_s</code> or <code>gps_week,tow_s</code>; <code>system,satellite</code> or <code>sv</code>; <code>pseudorange_m</code>; maybe <code>range_rate_mps</code>, <code>cn0_dbhz</code>, <code>sigma_m</code>, <code>frequency_hz</code>, <code>sat_x_m</code> ...</td>
<td>navigation, unless it names the satellites' places</td>
</tr>
</tbody>
</table></div>
<p>Files that belong together are one drive: a zip, a folder, <code>--together</code>, or several parts called <code>file</code> of one upload. Sensors may come in a file of their own, such as a Versant CSV with <code>odo_speed_mps</code> and <code>gyr_z_dps</code>.</p>
<pre tabindex="0"><code>versant track OBS.rnx NAV.rnx --together -o track.csv
versant fuse FOLDER --roads town.osm --dem dem.tif --gnss one-sided -o slopes.geojson
versant upload OBS.rnx NAV.rnx --together --gnss one-sided --wait
versant gnss-study OBS.rnx NAV.rnx -o study.png
</code></pre>
<p><code>versant track</code> writes the covariance of each position (east, north, up) and, for solvers that say it, the probability of each satellite's having been reflected.</p>
<h2 id="which-solver"><a class="self" href="#which-solver">Which solver</a></h2>
<p><code>auto</code> is the default: <code>one-sided</code> where a log has raw measurements and states no better accuracy of its own (median of its stated radii), else the receiver's own positions. Name <code>receiver</code> to keep those in any case.</p>
<ul>
<li><code>one-sided</code> is for every log that is driven. It is the most accurate here, its sigmas are true, and it takes all that helps: Doppler, odometer, gyroscope, and the elevation model's height where a road is matched.</li>
<li><code>ls</code>, <code>wls</code>, <code>ekf</code> show what plain estimators make of the same data; <code>ekf</code> is sound in the open.</li>
<li><code>pf</code>, <code>jms-gmm</code>, <code>rbpf-dpm</code> are the thesis's, in a sound reading. <code>--gnss-option reading=literal</code> shows what the printed algorithms do.</li>
</ul>
<p>The sigmas that a fix is published with never fall below 5 m horizontally and 10 m vertically: what is common to all satellites and lasts, no filter sees.</p>
<p><strong>No slope is made of such heights alone.</strong> They change by 5 to 15 m within a hundred metres of street, and a smoother makes them look far better than they are: on smartLoc a line through them is wrong by 1.7 % and says 0.3 %. So slopes take the places; the grade comes from Doppler (epoch by epoch, not smoothed), attitude, force, pressure and
elevation models. A drive that has none of these is laid on its roads, is done, and says why it gives no slope.</p>
<h2 id="from-signals-to-measurements"><a class="self" href="#from-signals-to-measurements">From signals to measurements</a></h2>
<p><code>fusion/gnss/</code> has a room for each step. <strong><code>orbits/</code></strong>: broadcast ephemerides of GPS, Galileo, BeiDou (GEO as well), QZSS by Kepler's elements, GLONASS by Runge-Kutta; relativity and the group delay of the L1 band; the nearest healthy record within its time (GPS and QZSS 2 h, Galileo 4 h, BeiDou 2 h, GLONASS 30 min), else no satellite. <strong><code>corrections.py</code></strong>:
Klobuchar (without the thesis's misprints: 0.022, semicircles, the ICD's clamps), Saastamoinen with Niell's mapping, the earth's turn during the flight. <strong><code>measure.py</code></strong> puts them together: a rough place from nothing, a mask of 5 degrees, a bias for each further system, and the receiver clock's jumps of n x 1 ms taken out (a step that is none begins a new clock).
Whatever is left out is counted by reason in the drive's report, and what a person must know is a sentence there: no navigation for a system, navigation of another day (both dates), fewer than four satellites.</p>
<p><code>python benchmarks/orbits.py ../shared/data/gnss</code>:</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>beside</th>
<th>system</th>
<th>satellites or records</th>
<th>places</th>
<th>clocks</th>
</tr>
</thead>
<tbody>
<tr>
<td>RTKLIB, the same records over a whole day (GLONASS: their half hour)</td>
<td>GPS, Galileo, BeiDou, QZSS; GLONASS</td>
<td>115, 38, 4, 4; 10 records</td>
<td>at most 2e-7 m; 4.5 mm</td>
<td>at most 1e-10 ns</td>
</tr>
<tr>
<td>precise product, 2021-04-28</td>
<td>GPS</td>
<td>31</td>
<td>rms 1.27 m, max 5.17 m; 97.3 % within 3 m</td>
<td>rms 1.72 ns, max 7.4 ns</td>
</tr>
<tr>
<td>precise product, 2023-03-14</td>
<td>GPS; Galileo; GLONASS</td>
<td>2 each</td>
<td>rms 0.62; 0.27; 2.24 m, max 0.78; 0.43; 2.70 m</td>
<td>max 0.16; 0.10; 5.0 ns</td>
</tr>
</tbody>
</table></div>
<p>After the common offset of clocks and the median offset of the antennas (precise places are of the centre of mass). Beyond 3 m is nearly only G14 in 2021, whose broadcast was off by 4 to 5 m along its orbit; all others stay within 3.14 m. The files hold extracts: no day of every system, none of BeiDou or QZSS beside a precise product.</p>
<h2 id="error-models"><a class="self" href="#error-models">Error models</a></h2>
<p><code>fusion/gnss/error_models/</code>, by name: <code>gaussian</code>, <code>gmm</code> (two normals by EM over 40 s), <code>dpm</code> (Polya urn), <code>one-sided</code>: with probability p = 1 / (1 + exp((C/N0 - 40) / 3)) a delay with an exponential law (mean 30 m) on top of the noise, whose variance is 2^2 + 1.5^2 10^((45 - C/N0) / 10) m2. The midpoint of p is learned from the log (receivers differ by several dB), and so is
the level of the noise. The reception state of the thesis (blocked, direct, reflected) comes from a threshold of C/N0 (40 dB-Hz u-blox, 42 PolaRx2) or the elevation line of its table 3.2, smoothed by its Markov chain.</p>
<h2 id="measured-smartloc-potsdamer-platz"><a class="self" href="#measured-smartloc-potsdamer-platz">Measured: smartLoc, Potsdamer Platz</a></h2>
<p>1372 epochs at 5 Hz, GPS and GLONASS, no Doppler, with odometer and gyroscope. <code>python benchmarks/pseudorange.py ../shared/data/smartloc</code>; five seeds where a solver draws. The thesis's real drive in Belfort is another place and receiver; its figures are beside for the order alone.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>solver</th>
<th>2-D mean / median / 95 %, m</th>
<th>3-D mean, m</th>
<th>in the 95 % ellipse</th>
<th>ms an epoch</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>ls</code></td>
<td>30.4 / 27.4 / 67.6</td>
<td>77.0</td>
<td>90.9 %</td>
<td>0.006</td>
</tr>
<tr>
<td><code>wls</code></td>
<td>21.3 / 18.3 / 47.8</td>
<td>45.4</td>
<td>97.7 %</td>
<td>0.007</td>
</tr>
<tr>
<td><code>ekf</code></td>
<td>20.5 / 17.8 / 42.7</td>
<td>43.0</td>
<td>95.9 %</td>
<td>0.015</td>
</tr>
<tr>
<td><code>pf</code> (bootstrap; FPLL, the default)</td>
<td>22.0 / 20.7 / 43.1; 22.2 / 20.5 / 44.6</td>
<td>45.9; 46.1</td>
<td>96.2; 95.2 %</td>
<td>0.8; 1.7</td>
</tr>
<tr>
<td><code>jms-gmm</code></td>
<td>20.1 / 18.4 / 41.7</td>
<td>29.9</td>
<td>96.0 %</td>
<td>1.9</td>
</tr>
<tr>
<td><code>rbpf-dpm</code></td>
<td>15.6 / 13.8 / 34.4</td>
<td>27.7</td>
<td>97.8 %</td>
<td>2.0</td>
</tr>
<tr>
<td><code>one-sided</code>, filter alone (<code>smooth=false odometer=false</code>)</td>
<td>11.8 / 10.3 / 25.0</td>
<td>17.7</td>
<td>88.1 %</td>
<td>0.075</td>
</tr>
<tr>
<td>... with odometer</td>
<td>7.6 / 6.8 / 14.0</td>
<td>11.5</td>
<td>92.0 %</td>
<td>0.085</td>
</tr>
<tr>
<td>... smoothed, without odometer</td>
<td>7.4 / 7.1 / 14.1</td>
<td>12.1</td>
<td>94.8 %</td>
<td>0.145</td>
</tr>
<tr>
<td><strong><code>one-sided</code></strong> (smoothed, odometer)</td>
<td><strong>4.8 / 5.0 / 6.6</strong></td>
<td><strong>7.8</strong></td>
<td>100 %</td>
<td>0.150</td>
</tr>
<tr>
<td>best of the literature, filter: Huber; with odometer: Cauchy</td>
<td>20.5 / 18.5 / 42.4; 11.2 / 9.5 / 28.5</td>
<td>41.8; 30.6</td>
<td>45; 44 %</td>
<td></td>
</tr>
<tr>
<td>best of the literature, smoothed: self-tuning mixture; with odometer: the same</td>
<td>13.3 / 12.2 / 30.1; 9.0 / 9.3 / 16.3</td>
<td>29.6; 20.9</td>
<td>22; 7 %</td>
<td></td>
</tr>
<tr>
<td>single points with RTKLIB's weights</td>
<td>27.8 / 24.7 / 66.0</td>
<td>71.1</td>
<td></td>
<td></td>
</tr>
</tbody>
</table></div>
<p>The literature's estimators (Gauss, Huber, Cauchy, Geman-McClure by iteration, dynamic covariance scaling, max-mixture, self-tuning mixture, each reimplemented from its paper) have the same motion model, odometer and inflation as ours and textbook constants; only the model of errors differs. All of them believe twice to ten times too much in themselves. RTKLIB itself wants ephemerides, which
this log has not; with <code>--rinex</code> its own single-point positioning is run on the same files and compared at the epochs that it has.</p>
<p>Fixed beforehand by the notes: the law, its constants, three iterations, process noises. Chosen with these errors in view: errors stay alike for 4 s (of 3, 4, 5 and 8; with 3 the smoother without odometer has 7.6 m, with 8 the filter 12.6), an error of 4.15 m that stays with a satellite (the sum of the thesis's table 3.3; half of it covered too little), and 30 m of way with an odometer.</p>
<p>Readings of the algorithms, where the print contradicts itself: the residual is measured minus predicted; a particle keeps its mean and covariance, nothing is sampled from them; the base of LOS is centred on 0; a line of sight's noise is added to what an urn draws; six satellites count as direct at least. The literal readings: <code>jms-gmm</code> 1.9 km, <code>rbpf-dpm</code> 28 m.</p>
<h2 id="measured-the-thesiss-simulated-run"><a class="self" href="#measured-the-thesiss-simulated-run">Measured: the thesis's simulated run</a></h2>
<p><code>python benchmarks/street_canyon.py --seeds 20</code>. The scene of Rouen is not public: route (8236 m, 594 epochs at 1 Hz), fronts and sky are drawn anew for each seed, reflections by geometry.</p>
<p>Mean 3-D error in m with the half width of its 95 % interval over 20 seeds, and the share of epochs within 5 m. <em>Ours</em>: the solvers as they are, made for real receivers. <em>Thesis</em>: what its simulation gave its filters (EKF and PF know white noise alone, the states are known to JMS-GMM and RBPF-DPM, errors last an epoch):</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>solver</th>
<th>published</th>
<th>ours</th>
<th>thesis reading</th>
</tr>
</thead>
<tbody>
<tr>
<td>EKF</td>
<td>6.02, 62 %</td>
<td>5.13 ± 0.37, 66 %</td>
<td>7.35 ± 0.95, 64 %</td>
</tr>
<tr>
<td>PF (FPLL)</td>
<td>4.28, 80 %</td>
<td>11.6 ± 1.8, 39 %</td>
<td>10.5 ± 1.5, 46 %</td>
</tr>
<tr>
<td>JMS-GMM</td>
<td>2.86, 87 %</td>
<td>6.08 ± 0.61, 58 %</td>
<td>4.68 ± 0.60, 75 %</td>
</tr>
<tr>
<td>RBPF-DPM</td>
<td>1.90, 97 %</td>
<td>5.10 ± 0.37, 66 %</td>
<td>3.97 ± 0.56, 80 %</td>
</tr>
<tr>
<td><code>one-sided</code></td>
<td>-</td>
<td>1.93 ± 0.10, 97 %</td>
<td>the same</td>
</tr>
</tbody>
</table></div>
<p>The published order EKF &gt; JMS-GMM &gt; RBPF-DPM comes out in the thesis reading (each pair in 95 to 100 % of the seeds), and not in ours: an EKF that weighs by C/N0 and elevation, and knows that errors last, already has what the models of JMS-GMM bring, and ties with RBPF-DPM. Three things differ between the readings at once; they were not separated.
The reading was written after a run in which the published order had failed. <strong>PF before EKF is not reproduced</strong>: both know the same law, the particle filter tends to the EKF as particles grow (N = 50, 200, 1000, 5000: 34.7, 9.8, 6.7, 5.8 m over six seeds, EKF 4.9), so the gain of a third that the thesis prints must come from something that it does not say.</p>
<p>Density tracking (share of true errors within 1, 2, 3 sigma of the model): on the satellite that is reflected most GMM 71.5, 92.3, 97.3 % (published 76.3, 88.1, 90.9) and DPM 97.2, 100, 100 % (85.5, 93.3, 96.4): its variances are too wide here.</p>
<h2 id="what-a-slope-gains"><a class="self" href="#what-a-slope-gains">What a slope gains</a></h2>
<p><code>python benchmarks/street_canyon.py --slopes</code>: drives of 15 minutes through simulated towns between fronts of 25 m, raw signals with Doppler; slopes of segments driven whole, against their truth.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>sky</th>
<th>positions</th>
<th>2-D error m</th>
<th>slope RMSE %</th>
<th>within 1.96 sigma</th>
</tr>
</thead>
<tbody>
<tr>
<td>GPS, Galileo, BeiDou</td>
<td><code>receiver</code></td>
<td>3.4</td>
<td>0.50</td>
<td>93.0 %</td>
</tr>
<tr>
<td></td>
<td><code>ekf</code></td>
<td>1.3</td>
<td>0.49</td>
<td>91.4 %</td>
</tr>
<tr>
<td></td>
<td><code>one-sided</code></td>
<td>0.3</td>
<td>0.48</td>
<td>90.7 %</td>
</tr>
<tr>
<td>GPS alone</td>
<td><code>receiver</code></td>
<td>7.7</td>
<td>1.01</td>
<td>92.0 %</td>
</tr>
<tr>
<td></td>
<td><code>ekf</code></td>
<td>2.0</td>
<td>0.94</td>
<td>92.0 %</td>
</tr>
<tr>
<td></td>
<td><code>one-sided</code></td>
<td>0.5</td>
<td>0.94</td>
<td>91.4 %</td>
</tr>
</tbody>
</table></div>
<p>Five seeds. <code>receiver</code> is what takes reflections at face value: weighted least squares epoch by epoch. <strong>A slope gains little from better places as long as the log has Doppler and the right road is found</strong> (4 to 7 % of RMSE here): the grade comes from Doppler, and a few metres along the road matter only where it bends. What is gained is the road: with positions tens of metres off, as on
Potsdamer Platz, a drive is laid on the wrong street. These simulated skies are kinder than that place (7 to 19 satellites, one reflection, no diffraction).</p>
<h2 id="options"><a class="self" href="#options">Options</a></h2>
<details><summary>Options of \`ekf\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>tau_s</code></td>
<td><code>2</code></td>
<td>&gt; 0, ≤ 60</td>
<td>How long the error of a pseudorange lasts, s (notes 6: 2 to 5).</td>
</tr>
<tr>
<td><code>doppler</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Take range rates where they are measured.</td>
</tr>
<tr>
<td><code>odometer</code></td>
<td><code>false</code></td>
<td>true, false</td>
<td>Take speed and yaw rate of the vehicle where they are known.</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`pf\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>particles</code></td>
<td><code>200</code></td>
<td>≥ 2, ≤ 100000</td>
<td>Number of particles N.</td>
</tr>
<tr>
<td><code>resampling</code></td>
<td><code>systematic</code></td>
<td>multinomial, residual, stratified, systematic</td>
<td>Scheme of resampling.</td>
</tr>
<tr>
<td><code>eta</code></td>
<td><code>0.7</code></td>
<td>&gt; 0, ≤ 1</td>
<td>Resampled where fewer than eta N particles count (0.6 to 0.8).</td>
</tr>
<tr>
<td><code>tau_s</code></td>
<td><code>2</code></td>
<td>&gt; 0, ≤ 60</td>
<td>How long the error of a pseudorange lasts, s (notes 6: 2 to 5).</td>
</tr>
<tr>
<td><code>proposal</code></td>
<td><code>fpll</code></td>
<td>bootstrap, fpll</td>
<td>bootstrap: the motion alone (Algorithm 7). fpll: a Kalman step by the epoch (Algorithm 8).</td>
</tr>
<tr>
<td><code>regularised</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Draw particles apart after resampling (Algorithm 6).</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`jms-gmm\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>particles</code></td>
<td><code>200</code></td>
<td>≥ 2, ≤ 100000</td>
<td>Number of particles N.</td>
</tr>
<tr>
<td><code>resampling</code></td>
<td><code>systematic</code></td>
<td>multinomial, residual, stratified, systematic</td>
<td>Scheme of resampling.</td>
</tr>
<tr>
<td><code>eta</code></td>
<td><code>0.7</code></td>
<td>&gt; 0, ≤ 1</td>
<td>Resampled where fewer than eta N particles count (0.6 to 0.8).</td>
</tr>
<tr>
<td><code>tau_s</code></td>
<td><code>2</code></td>
<td>&gt; 0, ≤ 60</td>
<td>How long the error of a pseudorange lasts, s (notes 6: 2 to 5).</td>
</tr>
<tr>
<td><code>reading</code></td>
<td><code>stabilised</code></td>
<td>stabilised, literal</td>
<td>stabilised, or literal: as printed, to see what happens.</td>
</tr>
<tr>
<td><code>threshold_dbhz</code></td>
<td><code>40</code></td>
<td>≥ 0, ≤ 60</td>
<td>C/N0 from which on a signal is direct: 40 u-blox, 42 PolaRx2.</td>
</tr>
<tr>
<td><code>window_s</code></td>
<td><code>40</code></td>
<td>&gt; 0, ≤ 600</td>
<td>How long residuals are kept, s.</td>
</tr>
<tr>
<td><code>components</code></td>
<td><code>2</code></td>
<td>≥ 1, ≤ 10</td>
<td>Normals of the mixture, J.</td>
</tr>
<tr>
<td><code>pseudo_count</code></td>
<td><code>1</code></td>
<td>&gt; 0</td>
<td>Added to each count of transitions.</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`rbpf-dpm\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>particles</code></td>
<td><code>200</code></td>
<td>≥ 2, ≤ 100000</td>
<td>Number of particles N.</td>
</tr>
<tr>
<td><code>resampling</code></td>
<td><code>systematic</code></td>
<td>multinomial, residual, stratified, systematic</td>
<td>Scheme of resampling.</td>
</tr>
<tr>
<td><code>eta</code></td>
<td><code>0.7</code></td>
<td>&gt; 0, ≤ 1</td>
<td>Resampled where fewer than eta N particles count (0.6 to 0.8).</td>
</tr>
<tr>
<td><code>tau_s</code></td>
<td><code>2</code></td>
<td>&gt; 0, ≤ 60</td>
<td>How long the error of a pseudorange lasts, s (notes 6: 2 to 5).</td>
</tr>
<tr>
<td><code>reading</code></td>
<td><code>stabilised</code></td>
<td>stabilised, literal</td>
<td>stabilised, or literal: as printed, to see what happens.</td>
</tr>
<tr>
<td><code>threshold_dbhz</code></td>
<td><code>40</code></td>
<td>≥ 0, ≤ 60</td>
<td>C/N0 from which on a signal is direct: 40 u-blox, 42 PolaRx2.</td>
</tr>
<tr>
<td><code>los_alpha</code></td>
<td><code>500</code></td>
<td>&gt; 0</td>
<td>Weight of new draws under line of sight (Table 3.11).</td>
</tr>
<tr>
<td><code>los_k</code></td>
<td><code>0.1</code></td>
<td>&gt; 0</td>
<td>Variance over variance of the mean, line of sight.</td>
</tr>
<tr>
<td><code>los_dof</code></td>
<td><code>10</code></td>
<td>&gt; 0</td>
<td>Degrees of freedom of the variance, line of sight.</td>
</tr>
<tr>
<td><code>los_scale_m2</code></td>
<td><code>1</code></td>
<td>&gt; 0</td>
<td>Scale of the variance, m2, line of sight.</td>
</tr>
<tr>
<td><code>nlos_alpha</code></td>
<td><code>3000</code></td>
<td>&gt; 0</td>
<td>Weight of new draws under reflection (Table 3.9).</td>
</tr>
<tr>
<td><code>nlos_k</code></td>
<td><code>1</code></td>
<td>&gt; 0</td>
<td>Variance over variance of the mean, reflected.</td>
</tr>
<tr>
<td><code>nlos_dof</code></td>
<td><code>5</code></td>
<td>&gt; 0</td>
<td>Degrees of freedom of the variance, reflected.</td>
</tr>
<tr>
<td><code>nlos_scale_m2</code></td>
<td><code>10</code></td>
<td>&gt; 0</td>
<td>Scale of the variance, m2, reflected.</td>
</tr>
<tr>
<td><code>memory</code></td>
<td><code>600</code></td>
<td>≥ 1, ≤ 10000</td>
<td>Epochs that an urn remembers (the thesis: all of its 594).</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`one-sided\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>smooth</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>let each epoch know the whole drive, not only what came before it</td>
</tr>
<tr>
<td><code>odometer</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>use odometer speed and yaw rate where the log has them</td>
</tr>
<tr>
<td><code>doppler</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>use range rates from Doppler where the log has them</td>
</tr>
<tr>
<td><code>height</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>use heights from map and elevation model where they are known</td>
</tr>
</tbody>
</table></div>
</details>
`;export{e as default};