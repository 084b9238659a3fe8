//! The page: one HTML file beside its data, opened from disk, without network.

use std::fmt::Write as _;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use half::f16;
use serde_json::json;

use super::analysis::reach;
use super::experiment::Comparison;
use super::plot::{Against, KINDS, Measure, errors, parts, ratios, times};
use super::results::{FILE, Interval, ORACLE, Reach, Results, SCHEMA_FILE};
use crate::base::Result;
use crate::base::files::write_bytes;
use crate::film::pixel_error;
use crate::picture::{Display, Image, read_image, write_png};

const STYLE: &str = include_str!("page/page.css");
const VIEWER: &str = include_str!("page/viewer.js");

/// Number of worst places that the viewer offers.
const WORST: usize = 12;

/// Writes `results.json` and its schema, `runs.csv`, the plots, the viewer's data and `index.html` into `folder`.
///
/// # Errors
/// [`Error::Io`](crate::base::Error::Io), and [`Error::Options`](crate::base::Error::Options) where something cannot be drawn.
pub fn write(comparison: &Comparison, folder: &Path) -> Result<()> {
    let results = &comparison.results;
    results.write(&folder.join(FILE))?;
    Results::write_schema(&folder.join(SCHEMA_FILE))?;
    write_bytes(&folder.join("runs.csv"), csv(results).as_bytes())?;
    let mut plots = String::new();
    for measure in Measure::ALL {
        for against in Against::ALL {
            let svg = errors(results, against, measure)?;
            let name = format!("{}-{}.svg", measure.slug(), against.name());
            write_bytes(&folder.join("plots").join(&name), svg.as_bytes())?;
            let _ = writeln!(
                plots,
                "<figure>{svg}<figcaption>{} over {} (<a href=\"plots/{name}\">SVG</a>)</figcaption></figure>",
                measure.name(),
                if against == Against::Seconds { "seconds" } else { "samples per pixel" }
            );
        }
    }
    for against in Against::ALL {
        let Some(svg) = ratios(results, against)? else { continue };
        let name = format!("ratio-{}.svg", against.name());
        write_bytes(&folder.join("plots").join(&name), svg.as_bytes())?;
        let told = if against == Against::Seconds { crossovers(results) } else { String::new() };
        let _ = writeln!(
            plots,
            "<figure>{svg}<figcaption>error over that of {} (<a href=\"plots/{name}\">SVG</a>){told}</figcaption></figure>",
            escape(&results.methods[0]),
        );
    }
    let bars = times(results)?;
    write_bytes(&folder.join("plots").join("times.svg"), bars.as_bytes())?;
    let pictures = pictures(comparison, folder)?;
    let mut scripts = String::new();
    for (name, label, image) in &pictures {
        let data = json!({"label": label, "data": STANDARD.encode(halves(image))});
        let name_json = json!(name);
        let script = format!("window.fanal.pictures[{name_json}] = {data};\n");
        write_bytes(&folder.join("data").join(format!("picture-{name}.js")), script.as_bytes())?;
        write_bytes(
            &folder.join("data").join(format!("{name}.png")),
            &write_png::encode(image, Display { exposure: exposure(comparison), ..Display::default() })?,
        )?;
        let _ = writeln!(scripts, "<script src=\"data/picture-{name}.js\"></script>");
    }
    write_bytes(&folder.join("data").join("guides.js"), guides(comparison).as_bytes())?;
    scripts.push_str("<script src=\"data/guides.js\"></script>\n");
    let worst = worst(&pictures, &comparison.reference);
    let data = json!({
        "scene": results.scene.name,
        "width": results.scene.width,
        "height": results.scene.height,
        "methods": pictures.iter().map(|p| p.0.clone()).filter(|n| n != "reference").collect::<Vec<_>>(),
        "budget": results.budgets.last().map(|b| b.label()),
        "exposure": exposure(comparison),
        "worst": worst,
        "pictures": {},
        "guides": null,
    });
    let html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n<header><h1>{title}</h1>\n<p class=\"lead\">{lead}</p></header>\n\
         <section id=\"time-to-reach\"><h2>Time to reach an error</h2>\n{reach}</section>\n\
         <section id=\"plots\"><h2>Error over cost</h2>\n{plots}</section>\n\
         <section id=\"runs\"><h2>Methods and budgets</h2>\n{summary}</section>\n\
         <section id=\"where\"><h2>Where the time goes</h2>\n<figure>{bars}</figure>\n{time_table}</section>\n\
         <section id=\"viewer\"></section>\n<footer>{footer}</footer>\n</main>\n\
         <script>window.fanal = {data};</script>\n{scripts}<script>\n{VIEWER}</script>\n</body>\n</html>\n",
        title = escape(&format!("{}: what accuracy costs in time", results.scene.name)),
        lead = escape(&lead(comparison)),
        reach = reach_table(results),
        summary = summary_table(results),
        time_table = time_table(results),
        footer = "Numbers are from <a href=\"results.json\">results.json</a> and <a href=\"runs.csv\">runs.csv</a>; \
                  every picture is in the folder <code>runs</code>.",
        // A tag or a comment inside the data would change where the script ends.
        data = data.to_string().replace('<', "\\u003c"),
    );
    write_bytes(&folder.join("index.html"), html.as_bytes())
}

/// From when on each method is better than the first, in words.
fn crossovers(results: &Results) -> String {
    let told = |method: &String| {
        let of = results.summary.iter().filter(|s| s.method == *method);
        let curve: Vec<(f64, f64)> = of.filter_map(|s| Some((s.seconds, s.ratio?.mean))).collect();
        let when = match reach(&curve, 1.0) {
            Reach::At(seconds) => format!("less from {} s on", number(seconds)),
            Reach::Before(seconds) => format!("not more from {} s on", number(seconds)),
            Reach::Never => "more to the last".to_owned(),
        };
        format!("; {}: {when}", escape(method))
    };
    results.methods.iter().skip(1).filter(|method| is_measured(results, method)).map(told).collect()
}

/// Whether there are runs of a method.
fn is_measured(results: &Results, method: &str) -> bool {
    results.summary.iter().any(|entry| entry.method == *method)
}

fn lead(comparison: &Comparison) -> String {
    let results = &comparison.results;
    let r = &results.reference;
    let noise = r.relative_variance.map_or_else(
        || "its own noise is not known and not subtracted".into(),
        |v| format!("its own relMSE of {} is subtracted", number(v)),
    );
    let oracle = results.oracle_spp.map_or(String::new(), |spp| {
        format!(" The oracle is guided by trees from {spp} samples per pixel, whose cost is not counted.")
    });
    let denoised = results.denoiser.as_ref().map_or(String::new(), |name| {
        format!(" Dashed lines are of the same pictures denoised ({name}), the time for that included.")
    });
    let interruption = comparison.interruption().map_or(String::new(), |text| format!(" {text}"));
    format!(
        "{} × {} pixels, depth {}, {} threads, {} seeds. Reference: {}; {noise}. Means over seeds are geometric, bands are 95 % \
         bootstrap intervals.{oracle}{denoised}{interruption}",
        results.scene.width,
        results.scene.height,
        results.scene.max_depth,
        results.threads,
        results.seeds.len(),
        r.origin
    )
}

/// Formats a number with three significant digits, for tables.
pub fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = (2 - value.abs().log10().floor() as i32).max(0) as usize;
    if (1e-4..1e6).contains(&value.abs()) { format!("{value:.digits$}") } else { format!("{value:.2e}") }
}

fn cell(value: f64, best: bool) -> String {
    format!("<td class=\"n{}\">{}</td>", if best { " best" } else { "" }, number(value))
}

fn missing() -> String {
    "<td class=\"missing\">–</td>".into()
}

fn interval(i: Interval, best: bool) -> String {
    let class = if best { " best" } else { "" };
    format!("<td class=\"n{class}\">{} <small>[{}, {}]</small></td>", number(i.mean), number(i.low), number(i.high))
}

fn table(head: &[String], rows: &str) -> String {
    let head: String = head.iter().map(|h| format!("<th>{}</th>", escape(h))).collect();
    format!("<div class=\"scroll\"><table><thead><tr>{head}</tr></thead><tbody>\n{rows}</tbody></table></div>\n")
}

fn reach_table(results: &Results) -> String {
    if results.time_to_reach.is_empty() {
        return "<p>No round error lies between the best and the worst measured.</p>".into();
    }
    let seconds = |reach: &Reach| match *reach {
        Reach::At(t) | Reach::Before(t) => Some(t),
        Reach::Never => None,
    };
    let mut head = vec!["trimmed relMSE".to_owned()];
    for (i, method) in results.methods.iter().enumerate() {
        head.push(format!("{method}, s"));
        if i > 0 {
            head.push(format!("speed-up over {}", results.methods[0]));
        }
    }
    let mut rows = String::new();
    for target in &results.time_to_reach {
        let rivals = results.methods.iter().zip(&target.methods).filter(|(method, _)| *method != ORACLE);
        let best = rivals.filter_map(|(_, reach)| seconds(reach)).fold(f64::INFINITY, f64::min);
        let _ = write!(rows, "<tr><th>{}</th>", number(target.error));
        for (i, reach) in target.methods.iter().enumerate() {
            rows.push_str(&match *reach {
                Reach::At(t) => cell(t, t == best && results.methods[i] != ORACLE),
                Reach::Before(t) => format!("<td class=\"n\">≤ {}</td>", number(t)),
                Reach::Never if !is_measured(results, &results.methods[i]) => missing(),
                Reach::Never => "<td class=\"missing\">not reached</td>".into(),
            });
            if i > 0 {
                rows.push_str(&speed_up(target.methods[0], *reach));
            }
        }
        rows.push_str("</tr>\n");
    }
    table(&head, &rows)
}

/// Table cell: time of `first` over that of `second`; only a bound where one of them was better from its smallest budget on.
fn speed_up(first: Reach, second: Reach) -> String {
    match (first, second) {
        (Reach::At(a), Reach::At(b)) => cell(a / b, false),
        (Reach::At(a), Reach::Before(b)) => format!("<td class=\"n\">≥ {}</td>", number(a / b)),
        (Reach::Before(a), Reach::At(b)) => format!("<td class=\"n\">≤ {}</td>", number(a / b)),
        _ => missing(),
    }
}

fn summary_table(results: &Results) -> String {
    let first = results.methods.first().map_or("", String::as_str);
    let head = [
        "budget",
        "method",
        "spp",
        "seconds",
        "CPU seconds",
        "relMSE",
        "trimmed relMSE",
        "LDR relMSE",
        &format!("trimmed, over {first}"),
    ]
    .map(str::to_owned);
    let denoises = results.denoiser.is_some();
    let head: Vec<String> = head.into_iter().chain(denoises.then(|| "trimmed, denoised".to_owned())).collect();
    let mut rows = String::new();
    for s in &results.summary {
        let denoised = || s.denoised.map_or_else(missing, |denoised| interval(denoised.relmse_trimmed, false));
        let rivals = || results.summary.iter().filter(|r| r.budget == s.budget && r.method != ORACLE);
        let is_best =
            |pick: fn(&super::results::SummaryEntry) -> f64| s.method != ORACLE && rivals().all(|r| pick(s) <= pick(r));
        let _ = writeln!(
            rows,
            "<tr><th>{}</th><th>{}</th>{}{}{}{}{}{}{}{}</tr>",
            results.budgets[s.budget].label(),
            escape(&s.method),
            cell(s.spp, false),
            cell(s.seconds, false),
            s.cpu_seconds.map_or_else(missing, |c| cell(c, false)),
            interval(s.relmse, is_best(|s| s.relmse.mean)),
            interval(s.relmse_trimmed, is_best(|s| s.relmse_trimmed.mean)),
            interval(s.relmse_ldr, is_best(|s| s.relmse_ldr.mean)),
            s.ratio.map_or_else(missing, |ratio| interval(ratio, false)),
            if denoises { denoised() } else { String::new() },
        );
    }
    table(&head, &rows)
}

fn time_table(results: &Results) -> String {
    let head: Vec<String> =
        ["budget", "method"].into_iter().chain(KINDS.iter().map(|k| k.0)).map(str::to_owned).collect();
    let mut rows = String::new();
    for s in &results.summary {
        let cells: String = parts(results, s).iter().map(|&p| cell(p, false)).collect();
        let budget = results.budgets[s.budget].label();
        let _ = writeln!(rows, "<tr><th>{budget}</th><th>{}</th>{cells}</tr>", escape(&s.method));
    }
    format!("<p>Seconds, medians over seeds.</p>{}", table(&head, &rows))
}

/// The pictures to look at: each method's first seed at the largest budget, and the reference.
fn pictures(comparison: &Comparison, folder: &Path) -> Result<Vec<(String, String, Image)>> {
    let results = &comparison.results;
    let mut pictures = Vec::new();
    for method in &results.methods {
        let of = results.runs.iter().filter(|r| r.method == *method);
        let Some(run) = of.max_by_key(|r| (r.budget, std::cmp::Reverse(r.seed))) else { continue };
        let label = format!(
            "{method}, {:.1} s, {} spp, trimmed relMSE {}",
            run.seconds,
            run.spp,
            number(run.errors.relmse_trimmed)
        );
        pictures.push((method.clone(), label, read_image(&folder.join(&run.file), false)?));
    }
    pictures.push((
        "reference".into(),
        format!("reference ({})", results.reference.origin),
        comparison.reference.clone(),
    ));
    Ok(pictures)
}

/// Pixels as little-endian half floats, three per pixel, clamped to their range.
fn halves(image: &Image) -> Vec<u8> {
    let values = image.pixels.iter().flat_map(|p| p.to_array());
    values.flat_map(|v| f16::from_f32(v.clamp(-65504.0, 65504.0)).to_le_bytes()).collect()
}

/// Exposure in stops that brings the reference's mean to a middle grey, rounded to quarters.
fn exposure(comparison: &Comparison) -> f32 {
    let pixels = &comparison.reference.pixels;
    let mean = pixels.iter().map(|p| f64::from(p.element_sum()) / 3.0).sum::<f64>() / pixels.len().max(1) as f64;
    if mean > 0.0 { ((0.25 / mean).log2() * 4.0).round().clamp(-32.0, 32.0) as f32 / 4.0 } else { 0.0 }
}

/// The places of largest error over all methods, at most one per 16 × 16 pixels and method.
fn worst(pictures: &[(String, String, Image)], reference: &Image) -> Vec<serde_json::Value> {
    const CELL: usize = 16;
    let mut places: Vec<(f64, usize, usize, &str)> = Vec::new();
    for (name, _, image) in pictures.iter().filter(|p| p.0 != "reference") {
        let mut cells = std::collections::BTreeMap::new();
        for i in 0..image.pixels.len() {
            let (x, y) = (i % image.width, i / image.width);
            let error = pixel_error(image.pixels[i], reference.pixels[i]);
            let worst = cells.entry((x / CELL, y / CELL)).or_insert((0.0, 0, 0, name.as_str()));
            if error > worst.0 {
                *worst = (error, x, y, name.as_str());
            }
        }
        places.extend(cells.into_values());
    }
    places.sort_by(|a, b| b.0.total_cmp(&a.0));
    // Every method shows its own worst: the noisiest would otherwise fill the list.
    let each = WORST.div_ceil(pictures.len().saturating_sub(1).max(1));
    let mut taken = std::collections::BTreeMap::new();
    places.retain(|p| {
        let count = taken.entry(p.3.to_owned()).or_insert(0);
        *count += 1;
        *count <= each
    });
    places.iter().take(WORST).map(|p| json!({"x": p.1, "y": p.2, "method": p.3, "error": p.0})).collect()
}

fn guides(comparison: &Comparison) -> String {
    let Some((_, first)) = comparison.guides.first() else { return "window.fanal.guides = null;\n".into() };
    let maps: serde_json::Map<String, serde_json::Value> =
        comparison.guides.iter().map(|(name, guides)| (name.clone(), json!(guides.maps))).collect();
    let data = json!({"side": first.side, "step": first.step, "points": first.points, "maps": maps});
    format!("window.fanal.guides = {data};\n")
}

/// One line per run.
fn csv(results: &Results) -> String {
    let mut text = String::from(
        "method,budget,seed,spp,seconds,cpu_seconds,relmse,relmse_trimmed,relmse_ldr,mean_ratio,trace,photons,deposit,\
         reconstruct,write,dropped_samples,file,denoise,denoised_relmse,denoised_relmse_trimmed,denoised_relmse_ldr\n",
    );
    for r in &results.runs {
        let (e, p) = (&r.errors, &r.parts);
        let [cpu, mean_ratio] =
            [r.cpu_seconds, r.mean_ratio].map(|known| known.map_or(String::new(), |number| number.to_string()));
        let denoised = r.denoised.map_or(",,,".to_owned(), |denoised| {
            let e = &denoised.errors;
            format!("{},{},{},{}", denoised.seconds, e.relmse, e.relmse_trimmed, e.relmse_ldr)
        });
        let _ = writeln!(
            text,
            "{},{},{},{},{},{cpu},{},{},{},{mean_ratio},{},{},{},{},{},{},{},{denoised}",
            r.method,
            results.budgets[r.budget].label(),
            r.seed,
            r.spp,
            r.seconds,
            e.relmse,
            e.relmse_trimmed,
            e.relmse_ldr,
            p.trace,
            p.photons,
            p.deposit,
            p.reconstruct,
            p.write,
            r.dropped_samples,
            r.file
        );
    }
    text
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
