//! Every input under `corpus/` again, and cut short: what was once found stays mended. Alone in its binary, because the
//! allocator that bounds the memory of an input counts for the whole process.

use std::path::Path;

use drapery_fuzz::targets::TARGETS;

#[test]
fn every_input_of_the_corpus_is_read_or_refused() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    for (name, run) in TARGETS {
        let folder = std::fs::read_dir(corpus.join(name)).unwrap_or_else(|error| panic!("corpus/{name}: {error}"));
        let mut inputs: Vec<_> = folder.map(|entry| entry.expect("a folder that can be listed").path()).collect();
        inputs.sort();
        assert!(!inputs.is_empty(), "corpus/{name} is empty");
        for input in inputs {
            // Shown where the test fails; what the process dies of may have no other trace.
            println!("{}", input.display());
            let bytes = std::fs::read(&input).expect("an input can be read");
            run(&bytes);
            for eighth in 0..8 {
                run(&bytes[..bytes.len() * eighth / 8]);
            }
        }
    }
    std::fs::remove_dir_all(drapery_fuzz::scratch::folder()).expect("the folder of this process can be removed");
}
