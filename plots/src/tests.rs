use super::*;

fn page(x: &str) -> String {
    let curve = Series::new("a <b> & \"c\"", (0..10).map(|k| (f64::from(k), f64::from(k * k))));
    let gap = Series::new("gap", [(0.5, 1.0), (2.5, f64::NAN), (7.5, 3.0)]);
    let mut report = Report::new("A </title> of a page");
    report.lead("What is seen.").heading("One").text("</p><script>alert(1)</script>");
    report.table(&[vec!["".into(), "value".into()], vec!["    indented".into(), "1.5".into()]]);
    report.table(&[vec!["long".into()], vec!["a word ".repeat(9)]]);
    let plot = Plot::new("Plot", x, "y / unit", vec![curve, gap]).event(3.0, "</script> here");
    report.plot(&plot, "Caption").unwrap();
    report.html()
}

#[test]
fn a_page_loads_nothing_and_forbids_it() {
    let html = page("x / unit");
    assert_eq!(loads(&html), [""; 0]);
    assert_eq!(loads("<img src=\"x\"> url(y)"), [" src=", "url("]);
    assert!(html.contains("default-src 'none'"));
    assert!(html.contains("width=device-width"));
    assert!(html.contains("prefers-color-scheme:dark") && html.contains("@media print"));
}

#[test]
fn text_stays_text() {
    let html = page("x / unit");
    assert!(!html.contains("<script>alert") && !html.contains("</script> here") && !html.contains("A </title>"));
    assert!(html.contains("<td class=\"long\">a word"));
    assert!(html.contains("<td>    indented</td>") && html.contains("<td class=\"n\">1.5</td>"));
    // Two of the page, one of data; each closed.
    assert_eq!(html.matches("<script").count(), 3);
    assert_eq!(html.matches("</script>").count(), 3);
}

#[test]
fn the_script_gets_every_point_that_is_a_number() {
    let html = page("x / unit");
    let data = html.split("application/json\">").nth(1).unwrap().split("</script>").next().unwrap();
    let data: serde_json::Value = serde_json::from_str(data).unwrap();
    assert_eq!(data["names"][0], "a <b> & \"c\"");
    assert_eq!(data["curves"][0][1][9], 81.0);
    assert_eq!(data["curves"][1], serde_json::json!([[0.5, 7.5], [1.0, 3.0]]));
    assert_eq!(data["events"], serde_json::json!([[3.0, "</script> here"]]));
}

#[test]
fn curves_of_one_name_have_one_colour_and_one_place_in_the_legend() {
    let curve = |name: &str, y: f64| Series::new(name, [(0.0, y), (1.0, y)]);
    let series = vec![curve("kept", 1.0), curve("omitted", 2.0), curve("kept", 3.0), curve("average", 4.0)];
    let plot = Plot::new("", "x", "y", series);
    assert_eq!(plot.svg().unwrap().matches("kept").count(), 1);
    let data: serde_json::Value = serde_json::from_str(&plot.data().unwrap()).unwrap();
    for colours in ["light", "dark"].map(|page| data[page].as_array().unwrap()) {
        assert_eq!(colours[0], colours[2]);
        assert!(colours[0] != colours[1] && colours[1] != colours[3] && colours[3] != colours[0]);
    }
}

#[test]
fn a_curve_that_goes_back_stays_a_picture() {
    let back = Series::new("back", [(0.0, 0.0), (1.0, 1.0), (0.5, 2.0)]);
    let mut report = Report::new("");
    report.plot(&Plot::new("", "x", "y", vec![back]), "").unwrap();
    let html = report.html();
    assert!(html.contains("<svg") && !html.contains("<script"));
}

#[test]
fn a_plot_without_a_point_is_refused() {
    let empty = Plot::new("", "x", "y", vec![Series::new("", [(f64::NAN, 1.0)])]);
    assert!(Report::new("").plot(&empty, "").is_err());
}

#[test]
fn many_headings_make_a_list_of_them() {
    let mut report = Report::new("");
    for k in 0..6 {
        report.heading(&format!("Heading {k}"));
    }
    let html = report.html();
    assert_eq!(html.matches("<a href=\"#h").count(), 6);
    assert!((0..6).all(|k| html.contains(&format!("id=\"h{k}\""))));
}

#[test]
fn bars_have_their_values_beside_them() {
    let bars = |values: &[f64]| Bars {
        title: "Bars".into(),
        x: "degrees".into(),
        bars: values.iter().map(|value| ("<a>".into(), *value)).collect(),
    };
    let html = bars(&[0.0, 5.0, 50.0]).html().unwrap();
    assert!(html.contains("&lt;a&gt;: 5.0 degrees") && html.contains("> 50.0</div>"));
    assert!(["width:calc(0.0%", "width:calc(50.0%", "width:calc(100.0%"].iter().all(|width| html.contains(width)));
    assert!(bars(&[]).html().is_err() && bars(&[f64::NAN]).html().is_err());
}
