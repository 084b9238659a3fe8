//! Parts of a data set that are not all there.

use crate::files::{Files, scene};
use crate::parts::{refused, works};

fn recipe(files: &Files) -> String {
    let text = "name = \"tiny\"\nseed = 3\nheld_out = 0.25\nresolution = [16, 16]\niterations = [1]\ngrids = [12]\n\
                target_spp = 8\nmax_trees_per_scene = 4\n[[family]]\nname = \"rooms\"\nscenes = 3\n";
    std::fs::write(files.path("tiny.toml"), text).unwrap();
    files.text("tiny.toml")
}

/// An index says nothing of whether all scenes are in it, and parts of what it lacks are no leftovers.
#[test]
fn an_index_alone_is_not_called_whole() {
    let files = Files::new();
    let (tiny, data) = (recipe(&files), files.text("data"));
    let index = files.path("data/index.jsonl");
    works(&["dataset", &tiny, "-o", &data, "--quiet", "--part", "1/2"]);
    let part = std::fs::read(files.path("data/index.1-2.json")).unwrap();
    works(&["dataset", &tiny, "-o", &data, "--quiet", "--part", "2/2"]);
    works(&["merge", &data]);
    let told = works(&["merge", &data]);
    assert!(told.contains("there are no parts") && !told.contains("whole"), "{told}");
    let lines = std::fs::read_to_string(&index).unwrap();
    std::fs::write(&index, lines.lines().next().unwrap()).unwrap();
    assert!(!works(&["merge", &data]).contains("whole"));
    std::fs::write(&index, lines.lines().step_by(2).collect::<Vec<_>>().join("\n")).unwrap();
    std::fs::write(files.path("data/index.1-2.json"), part).unwrap();
    assert!(refused(&["merge", &data]).contains("index.1-2.json"), "one scene is in neither");
    assert!(files.path("data/index.1-2.json").exists());
}

/// Parts are of the same data whatever folder a recipe with scenes of files is followed from.
#[test]
fn parts_know_scenes_by_name() {
    let files = Files::new();
    let text = std::fs::read_to_string(recipe(&files)).unwrap();
    let text = text.replace("[[family]]\nname = \"rooms\"\nscenes = 3", "[[scene]]\nfile = \"cornell/scene.json\"");
    for folder in ["a", "b"] {
        std::fs::create_dir_all(files.path(&format!("{folder}/cornell"))).unwrap();
        std::fs::copy(scene("cornell") + "/scene.json", files.path(&format!("{folder}/cornell/scene.json"))).unwrap();
        std::fs::write(files.path(&format!("{folder}/tiny.toml")), &text).unwrap();
    }
    let data = files.text("data");
    works(&["dataset", &files.text("a/tiny.toml"), "-o", &data, "--quiet", "--part", "1/2"]);
    works(&["dataset", &files.text("b/tiny.toml"), "-o", &data, "--quiet", "--part", "2/2"]);
    works(&["merge", &data]);
    works(&["dataset", "--check", &data]);
}

/// Of very many missing parts the first are named.
#[test]
fn f04_messages_stay_short() {
    let files = Files::new();
    let (tiny, data) = (recipe(&files), files.text("data"));
    works(&["dataset", &tiny, "-o", &data, "--quiet", "--part", "5/1048576"]);
    let told = refused(&["merge", &data]);
    assert!(told.contains("4/1048576, 6/1048576") && told.contains("1048559 more") && told.len() < 1000, "{told}");
}
