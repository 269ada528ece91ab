//! The guide shows the example `cape` as it is.

#[test]
fn the_guide_has_the_program_that_is_compiled() {
    let (guide, example) = (include_str!("../../../docs/guide.md"), include_str!("../examples/cape.rs"));
    let program = &example[example.find("use bevy::").expect("it uses Bevy")..];
    assert!(program.len() > 1000 && guide.contains(program), "copy examples/cape.rs into docs/guide.md");
}
