//! `fanal compare`: every number on the page follows from the pictures, an interrupted comparison goes on, the page works.

use crate::support::stop;

use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::Ordering;

use fanal::picture::{Image, read_image, write};
use fanal::reconstruct::Neural;
use fanal::render::{GuideMode, RenderSettings, StopRule};
use fanal::report::results::{Reach, Results, SummaryEntry};
use fanal::report::{Budget, Experiment, Method, page};
use fanal::scene::readers::load;
use glam::Vec3;
use stop::StopAfter;

const DRIVER: &str = include_str!("../support/drive-page.js");

/// Compares on a small picture of the diffuse box, 2 budgets and `seeds` seeds.
fn compare(folder: &Path, seeds: &str) -> Output {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell").display().to_string();
    let output = folder.display().to_string();
    let fixed = ["--spp", "16,4", "--size", "40x30", "--reference-spp", "64", "--oracle-spp", "32"];
    let result = Command::new(env!("CARGO_BIN_EXE_fanal"))
        .args(["compare", &scene, "-o", &output, "--seeds", seeds, "--methods", "none,hybrid,neural,oracle"])
        .args(fixed)
        .output()
        .expect("the program was built for this test");
    assert!(result.status.success(), "{}", String::from_utf8_lossy(&result.stderr));
    result
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 * b.abs().max(1e-6)
}

/// relMSE and trimmed relMSE against the truth, written down a second time: pixel errors less the reference's variance.
fn relative_errors(picture: &Image, reference: &Image, variance: &Image) -> [f64; 2] {
    let mut pixels: Vec<(f64, f64)> = (0..picture.pixels.len())
        .map(|i| {
            let [x, r, v] = [picture, reference, variance].map(|image| image.pixels[i].as_dvec3());
            let floor = r * r + 0.01;
            (((x - r) * (x - r) / floor).element_sum() / 3.0, (v / floor).element_sum() / 3.0)
        })
        .collect();
    let mean = |p: &[(f64, f64)]| p.iter().map(|(e, v)| e - v).sum::<f64>() / p.len() as f64;
    let all = mean(&pixels);
    pixels.sort_by(|a, b| b.0.total_cmp(&a.0));
    let dropped = pixels.len() / 1000;
    [all, mean(&pixels[dropped..])]
}

/// The cells of the first table in the section `id`, row by row, without tags.
fn table(html: &str, id: &str) -> Vec<Vec<String>> {
    let section = html.split(&format!("<section id=\"{id}\">")).nth(1).expect("the section is there");
    let body = section.split("<tbody>").nth(1).and_then(|s| s.split("</tbody>").next()).expect("it has a table");
    let text = |cell: &str| {
        let mut inside = false;
        let visible = cell.chars().filter(|&c| {
            inside |= c == '<';
            let keep = !inside;
            inside &= c != '>';
            keep
        });
        visible.collect::<String>().trim().to_owned()
    };
    let cells = |row: &str| -> Vec<String> {
        row.replace("</th>", "</td>").split("</td>").filter(|c| c.contains('>')).map(text).collect()
    };
    body.split("</tr>").map(cells).filter(|r: &Vec<String>| r.len() > 1).collect()
}

/// A number as shown, to its three digits.
fn shown(text: &str, value: f64) -> bool {
    let number: f64 = text.trim_start_matches(['≤', '≥', ' ']).parse().expect("a number");
    (number - value).abs() <= 0.006 * value.abs()
}

fn geometric(values: &[f64]) -> f64 {
    (values.iter().map(|v| v.ln()).sum::<f64>() / values.len() as f64).exp()
}

fn check_numbers(folder: &Path) -> Results {
    let results = Results::read(&folder.join("results.json")).expect("the schema holds");
    let read = |name: &str, raw| read_image(&folder.join(name), raw).expect("the picture is there");
    let reference = read(&results.reference.file, false);
    let variance = read(results.reference.variance_file.as_ref().expect("it was rendered here"), true);
    for run in &results.runs {
        let [relmse, trimmed] = relative_errors(&read(&run.file, false), &reference, &variance);
        assert!(close(relmse, run.errors.relmse), "{}: {relmse} {}", run.file, run.errors.relmse);
        assert!(close(trimmed, run.errors.relmse_trimmed), "{}: {trimmed} {}", run.file, run.errors.relmse_trimmed);
    }
    let summary = |s: &SummaryEntry| {
        let of = |method: &str| -> Vec<f64> {
            let runs = results.runs.iter().filter(|r| r.method == method && r.budget == s.budget);
            runs.map(|r| r.errors.relmse_trimmed).collect()
        };
        let (own, first) = (of(&s.method), of(&results.methods[0]));
        assert_eq!(own.len(), results.seeds.len());
        assert!(close(geometric(&own), s.relmse_trimmed.mean) && s.relmse_trimmed.low <= s.relmse_trimmed.mean);
        let ratio = s.ratio.expect("the first method was run").mean;
        assert!(close(geometric(&own) / geometric(&first), ratio), "{} {}", s.method, s.budget);
    };
    results.summary.iter().for_each(summary);
    check_page(&std::fs::read_to_string(folder.join("index.html")).expect("there is a page"), &results);
    let ratios = std::fs::read_to_string(folder.join("plots/ratio-seconds.svg")).expect("there are several methods");
    let named = |method: &String| ratios.contains(&format!("{method}\n")) || ratios.contains(&format!("{method}<"));
    assert!(results.methods[1..].iter().all(named), "a method is missing");
    results
}

/// Every number of the page's tables against `results.json`; the plot of ratios says of each method whether it ends below the first.
fn check_page(html: &str, results: &Results) {
    for method in results.methods.iter().skip(1) {
        let of = results.summary.iter().filter(|s| s.method == *method);
        let last = of.max_by(|a, b| a.seconds.total_cmp(&b.seconds)).and_then(|s| s.ratio).expect("it was run");
        let told = html.split(&format!("; {method}: ")).nth(1).expect("it is told");
        assert_eq!(told.starts_with("more to the last"), last.mean > 1.0, "{method}: {last:?}");
    }
    let rows = table(html, "runs");
    assert_eq!(rows.len(), results.summary.len());
    for (row, s) in rows.iter().zip(&results.summary) {
        assert_eq!((row[0].as_str(), row[1].as_str()), (results.budgets[s.budget].label().as_str(), s.method.as_str()));
        assert!(shown(&row[2], s.spp) && shown(&row[3], s.seconds), "{row:?}");
        for (cell, interval) in row[5..].iter().zip([s.relmse, s.relmse_trimmed, s.relmse_ldr, s.ratio.unwrap()]) {
            let numbers: Vec<&str> = cell.split(['[', ',', ']', ' ']).filter(|t| !t.is_empty()).collect();
            let expected = [interval.mean, interval.low, interval.high];
            assert!(
                numbers.len() == 3 && numbers.iter().zip(expected).all(|(t, v)| shown(t, v)),
                "{cell} {interval:?}"
            );
        }
    }
    let rows = if results.time_to_reach.is_empty() { vec![] } else { table(html, "time-to-reach") };
    for (row, target) in rows.iter().zip(&results.time_to_reach) {
        assert!(shown(&row[0], target.error));
        for (i, reach) in target.methods.iter().enumerate() {
            let cell = &row[if i == 0 { 1 } else { 2 * i }];
            match *reach {
                Reach::Never => assert_eq!(cell, "not reached"),
                Reach::At(t) => assert!(shown(cell, t) && !cell.starts_with('≤'), "{cell} {t}"),
                Reach::Before(t) => assert!(shown(cell, t) && cell.starts_with('≤'), "{cell} {t}"),
            }
            if let (true, Reach::At(a), Reach::At(b)) = (i > 0, target.methods[0], *reach) {
                assert!(shown(&row[2 * i + 1], a / b), "{row:?}");
            }
        }
    }
}

#[test]
fn numbers_follow_from_the_pictures_and_runs_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    compare(folder.path(), "2");
    let first = check_numbers(folder.path());
    check_schema(folder.path());
    assert_eq!(first.runs.len(), 2 * 2 * 4);
    let reference = std::fs::read(folder.path().join("reference.exr")).unwrap();
    // A picture that is gone is made again; the others stay, with the seconds that they took.
    std::fs::remove_file(folder.path().join(&first.runs[3].file)).unwrap();
    compare(folder.path(), "3");
    let second = check_numbers(folder.path());
    assert_eq!(second.runs.len(), 2 * 3 * 4);
    for (i, run) in first.runs.iter().enumerate() {
        let again = second.runs.iter().find(|r| r.file == run.file).expect("the run is still listed");
        assert_eq!(again.errors, run.errors, "{}: the same seed gives the same picture", run.file);
        assert!(i == 3 || again.seconds == run.seconds, "{} was rendered again", run.file);
    }
    assert_eq!(std::fs::read(folder.path().join("reference.exr")).unwrap(), reference);
    // So is a reference that is damaged.
    std::fs::write(folder.path().join("reference.exr"), &reference[..reference.len() / 2]).unwrap();
    compare(folder.path(), "3");
    assert_eq!(std::fs::read(folder.path().join("reference.exr")).unwrap(), reference);
}

/// On `spot` all light comes by way of a few millimetres that only photons find: an oracle that misses them shows nothing.
#[test]
fn the_oracle_knows_what_photons_find() {
    let folder = tempfile::tempdir().unwrap();
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/spot");
    let output = Command::new(env!("CARGO_BIN_EXE_fanal"))
        .args([
            "compare",
            &scene.display().to_string(),
            "-o",
            &folder.path().display().to_string(),
            "--methods",
            "oracle",
        ])
        .args(["--spp", "16", "--seeds", "1", "--size", "32x32", "--oracle-spp", "256", "--reference-spp", "1"])
        .output()
        .expect("the program was built for this test");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let picture = read_image(&folder.path().join("runs/oracle-16spp-1.exr"), false).unwrap();
    let lit = picture.pixels.iter().filter(|pixel| pixel.max_element() > 0.01).count();
    assert!(2 * lit > picture.pixels.len(), "{lit} of {} pixels are lit", picture.pixels.len());
}

/// A comparison by methods, of pictures of 16 × 12 pixels.
fn run(scene: &Path, folder: &Path, methods: &[Method], budgets: &[Budget], depth: u32, stop: &StopAfter) -> Results {
    let loaded = load(scene).unwrap();
    let neural = Neural::built_in().unwrap();
    let mut settings = RenderSettings::new(GuideMode::Neural, StopRule::Spp(1));
    settings.transport.max_depth = depth;
    let experiment = Experiment {
        loaded: &loaded,
        path: scene.display().to_string(),
        load_seconds: 0.0,
        settings,
        size: [16, 12],
        methods: methods.to_vec(),
        variants: &[],
        budgets: budgets.to_vec(),
        seeds: 1,
        // Any picture will do.
        reference: Some((folder.join("reference.exr"), None)),
        reference_spp: 1,
        oracle_spp: 1,
        denoiser: None,
        neural: &neural,
        folder,
    };
    let comparison = experiment.run(stop, &stop.now).unwrap();
    page::write(&comparison, folder).unwrap();
    Results::read(&folder.join("results.json")).expect("what is written can be read")
}

/// A folder with a copy of a committed scene, and a grey picture to compare with.
fn with_scene(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    std::fs::create_dir(&scene).unwrap();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    for file in std::fs::read_dir(source).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_file()) {
        std::fs::copy(&file, scene.join(file.file_name().unwrap())).unwrap();
    }
    let grey = Image { width: 16, height: 12, pixels: vec![Vec3::splat(0.5); 16 * 12] };
    write(&folder.path().join("reference.exr"), &grey, &[]).unwrap();
    (folder, scene)
}

const NONE: Method = Method::Guide(GuideMode::None);

/// A variant stands beside the modes under its name, with the picture of its options; other options under that name are another run.
#[test]
fn variants_are_methods_with_names() {
    let (folder, scene) = with_scene("cornell");
    let compare = |methods: &str, variant: &str| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_fanal"))
            .args(["compare", "--spp", "4", "--seeds", "1", "--size", "16x12", "--quiet", "--methods", methods])
            .args(["--variant", variant, "--reference"])
            .args([&folder.path().join("reference.exr"), Path::new("-o"), folder.path(), &scene])
            .output()
            .expect("the program was built for this test");
        (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let picture = |name: &str| std::fs::read(folder.path().join(format!("runs/{name}-4spp-1.exr"))).unwrap();
    let pixels = |name: &str| {
        read_image(&folder.path().join(format!("runs/{name}-4spp-1.exr")), false).map(|image| image.pixels).unwrap()
    };
    assert_eq!(compare("none,variance", "mine: --guide none"), (true, String::new()));
    assert_eq!(pixels("mine"), pixels("none"));
    let results = Results::read(&folder.path().join("results.json")).expect("what is written can be read");
    assert_eq!(results.methods, ["none", "variance", "mine"]);
    let (first, kept) = (picture("mine"), std::fs::metadata(folder.path().join("runs/none-4spp-1.exr")).unwrap());
    assert_eq!(compare("none,variance", "mine: --guide none --roulette off"), (true, String::new()));
    assert_ne!(picture("mine"), first, "other options");
    let again = std::fs::metadata(folder.path().join("runs/none-4spp-1.exr")).unwrap();
    assert_eq!(again.modified().unwrap(), kept.modified().unwrap(), "the same run");
    for (variant, why) in [("none: --guide none", "another method called none"), ("a: --seed 3", "--seed is the same")]
    {
        let (whole, told) = compare("none", variant);
        assert!(!whole && told.contains(why), "{told}");
    }
}

/// Runs are kept for the scene that they were made of, meshes included.
#[test]
fn another_mesh_is_another_scene() {
    let (folder, scene) = with_scene("glass-caustic");
    let picture = || read_image(&folder.path().join("runs/none-4spp-1.exr"), false).unwrap();
    let compared = || run(&scene, folder.path(), &[NONE], &[Budget::Spp(4)], 8, &StopAfter::new(9)).scene.crc32;
    let (crc, first) = (compared(), picture());
    assert_eq!(compared(), crc);
    let mesh = scene.join("ring.obj");
    let text = std::fs::read_to_string(&mesh).unwrap();
    let lifted = |line: &str| match line.strip_prefix("v ").map(|rest| rest.split(' ').collect::<Vec<_>>()) {
        Some(at) => format!("v {} {} {}", at[0], at[1].parse::<f32>().unwrap() + 0.3, at[2]),
        None => line.to_owned(),
    };
    std::fs::write(&mesh, text.lines().map(lifted).collect::<Vec<_>>().join("\n")).unwrap();
    assert_ne!(compared(), crc);
    assert_ne!(picture().pixels, first.pixels, "the run of the other mesh was kept");
}

/// One method of two was run: what there is is written, can be read, and goes on.
#[test]
fn an_interrupted_comparison_can_be_read() {
    let (folder, scene) = with_scene("cornell");
    let methods = [NONE, Method::Guide(GuideMode::Gaussian)];
    let compared = |stop: StopAfter| run(&scene, folder.path(), &methods, &[Budget::Spp(4)], 8, &stop);
    let part = compared(StopAfter::new(1));
    assert_eq!((part.runs.len(), part.summary.len()), (1, 1));
    assert!(part.summary[0].method == "gaussian" && part.summary[0].ratio.is_none());
    check_schema(folder.path());
    let page = || std::fs::read_to_string(folder.path().join("index.html")).unwrap();
    assert!(page().contains("Interrupted, one run is missing;"));
    let whole = compared(StopAfter::new(9));
    assert!(!page().contains("Interrupted"));
    assert!(whole.runs.len() == 2 && whole.summary.iter().all(|entry| entry.ratio.is_some()));
    assert_eq!(whole.runs.iter().find(|run| run.method == "gaussian").unwrap().seconds, part.runs[0].seconds);
}

/// What later budgets have is kept where an earlier one is interrupted, and no guide of other settings is shown.
#[test]
fn interrupted_comparisons_show_what_they_have() {
    let (folder, scene) = with_scene("cornell");
    let methods = [Method::Guide(GuideMode::Gaussian), NONE];
    let budgets = [Budget::Spp(4), Budget::Spp(8)];
    let compared = |depth, stop: StopAfter| run(&scene, folder.path(), &methods, &budgets, depth, &stop);
    let guides = || std::fs::read_to_string(folder.path().join("data/guides.js")).unwrap();
    let stopped = || {
        let stop = StopAfter::new(9);
        stop.now.store(true, Ordering::Relaxed);
        stop
    };
    assert_eq!(compared(8, StopAfter::new(9)).runs.len(), 4);
    assert!(guides().contains("gaussian"));
    std::fs::remove_file(folder.path().join("runs/none-4spp-1.exr")).unwrap();
    let part = compared(8, stopped());
    assert_eq!(part.runs.iter().map(|run| run.budget).collect::<Vec<_>>(), [0, 1, 1]);
    assert!(guides().contains("gaussian"));
    // The first run is without a guide; that of the guided one is of another depth.
    assert_eq!(compared(2, StopAfter::new(1)).runs.len(), 1);
    assert!(!guides().contains("gaussian"));
}

/// A run that is interrupted leaves no picture for the record of an earlier run with other settings.
#[test]
fn interrupted_runs_take_old_records_away() {
    let (folder, scene) = with_scene("cornell");
    let record = folder.path().join("runs/none-0.5s-1.json");
    let budget = Budget::Seconds(0.5);
    run(&scene, folder.path(), &[NONE], &[budget], 8, &StopAfter::new(9));
    assert!(record.exists());
    let stop = StopAfter::new(9);
    std::thread::scope(|scope| {
        let interrupted = scope.spawn(|| {
            // No run is finished, which is an error.
            std::panic::catch_unwind(AssertUnwindSafe(|| run(&scene, folder.path(), &[NONE], &[budget], 2, &stop)))
        });
        while record.exists() && !interrupted.is_finished() {
            std::thread::yield_now();
        }
        stop.now.store(true, Ordering::Relaxed);
        assert!(interrupted.join().unwrap().is_err());
    });
    assert!(!record.exists(), "the older record is there");
}

/// A scene of direct light only is guided where `--max-depth` asks for more.
#[test]
fn the_plan_knows_of_another_depth() {
    let (folder, scene) = with_scene("door-ajar");
    let file = scene.join("scene.json");
    let mut json: serde_json::Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    json["render"]["max_depth"] = 2.into();
    std::fs::write(&file, json.to_string()).unwrap();
    let out = folder.path().join("out");
    let compared = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_fanal"));
        command.args(["compare", scene.to_str().unwrap(), "-o", out.to_str().unwrap(), "--methods", "hybrid"]);
        command.args(["--spp", "64", "--seeds", "1", "--size", "24x18", "--reference-spp", "1", "--quiet"]).args(more);
        assert!(command.status().unwrap().success());
        let text = std::fs::read_to_string(out.join("runs/hybrid-64spp-guide.json")).unwrap();
        let guide: serde_json::Value = serde_json::from_str(&text).unwrap();
        guide["maps"].as_array().unwrap().iter().filter(|map| !map.is_null()).count()
    };
    assert_eq!(compared(&[]), 0);
    assert!(compared(&["--max-depth", "6"]) > 0);
}

/// Whether a value obeys a JSON Schema, as far as ours uses the language: references, types, properties, items, alternatives.
fn obeys(value: &serde_json::Value, schema: &serde_json::Value, root: &serde_json::Value) -> bool {
    if let Some(to) = schema["$ref"].as_str() {
        return obeys(value, root.pointer(to.trim_start_matches('#')).expect("references lead somewhere"), root);
    }
    let is = |name: &str| match name {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "null" => value.is_null(),
        other => panic!("the type {other} is new"),
    };
    let names =
        |v: &serde_json::Value| v.as_str().map(|s| vec![s.to_owned()]).or(serde_json::from_value(v.clone()).ok());
    let typed = names(&schema["type"]).is_none_or(|names: Vec<String>| names.iter().any(|name| is(name)));
    let least = schema["minimum"].as_f64().is_none_or(|least| value.as_f64().is_none_or(|v| v >= least));
    let listed = schema["enum"].as_array().is_none_or(|all| all.contains(value))
        && (schema["const"].is_null() || schema["const"] == *value);
    let choices = schema["oneOf"].as_array().or(schema["anyOf"].as_array());
    let chosen = choices.is_none_or(|all| all.iter().any(|one| obeys(value, one, root)));
    let items = value
        .as_array()
        .is_none_or(|v| schema["items"].is_null() || v.iter().all(|v| obeys(v, &schema["items"], root)));
    let members = value.as_object().is_none_or(|object| {
        let known = |(key, v): (&String, &serde_json::Value)| match schema["properties"].get(key) {
            Some(of) => obeys(v, of, root),
            None => schema["additionalProperties"] != serde_json::Value::Bool(false),
        };
        let required = schema["required"].as_array().into_iter().flatten();
        object.iter().all(known)
            && required.into_iter().all(|key| object.contains_key(key.as_str().unwrap_or_default()))
    });
    typed && least && listed && chosen && items && members
}

/// The schema is for programs that do not have our types: it must accept what we write, and nothing that they would not.
fn check_schema(folder: &Path) {
    let json = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(folder.join(name)).expect("it was written")).expect("it is JSON")
    };
    let schema = json("results.schema.json");
    let results = json("results.json");
    assert!(obeys(&results, &schema, &schema));
    let spoil: [fn(&mut serde_json::Value); 4] = [
        |r| r["runs"][0]["spp"] = serde_json::json!(-1),
        |r| r["summary"][0]["unknown"] = serde_json::json!(1),
        |r| drop(r.as_object_mut().map(|r| r.remove("scene"))),
        |r| r["budgets"][0] = serde_json::json!({"hours": 3}),
    ];
    for (i, spoil) in spoil.iter().enumerate() {
        let mut spoiled = results.clone();
        spoil(&mut spoiled);
        assert!(!obeys(&spoiled, &schema, &schema), "spoiled in way {i}");
        assert!(serde_json::from_value::<Results>(spoiled).is_err(), "spoiled in way {i}");
    }
}

/// Debian's chromium or another one, where there is any.
fn chromium() -> Option<PathBuf> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).flat_map(|d| names.map(|n| d.join(n))).find(|p| p.is_file())
}

/// Loads the page in a browser without network, uses everything on it, and wants no error.
#[test]
fn the_page_works_in_a_browser() {
    let Some(chromium) = chromium() else {
        println!("skipped: no chromium in PATH");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    compare(folder.path(), "1");
    let page = folder.path().join("index.html");
    let driver = format!("<script>\n{DRIVER}</script>\n");
    let html = std::fs::read_to_string(&page).unwrap();
    let html = html.replacen("<head>", &format!("<head>{driver}"), 1).replace("</body>", &format!("{driver}</body>"));
    std::fs::write(&page, html).unwrap();
    let phone = ["--screen-info={400x800}", "--start-maximized"];
    for size in [&phone[..], &["--window-size=500,900"], &["--window-size=1600,1200"]] {
        let profile = tempfile::tempdir().unwrap();
        let result = Command::new(&chromium)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=10000"])
            .args(size)
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .args(["--dump-dom", &format!("file://{}", page.display())])
            .output()
            .expect("chromium starts");
        let dom = String::from_utf8_lossy(&result.stdout);
        let found = dom.split("data-result=\"").nth(1).and_then(|s| s.split('"').next());
        assert_eq!(found, Some("ok"), "{size:?}: {}", String::from_utf8_lossy(&result.stderr));
    }
}
