"""Each small case of what ROS users do has relatives among these tests: forms of its kind."""

import os
import re
from pathlib import Path

import pytest
from loop_support import ROOT

# Folders with one case each, where they are at hand.
CASES = Path(os.environ.get('DVS_CASES', ROOT.parent / 'shared' / 'cases'))
RELATIVES = {
    '01-certified-pure-integrator': (
        'test_certified_is_never_worse_than_another_method',
        'test_the_run_of_a_textbook_plant_keeps_what_is_promised',
        'test_first_order_plant_reaches_the_closed_form',
        'test_a_comparison_shows_what_works_and_why_the_rest_does_not',
    ),
    '02-certified-n20-lp': (
        'test_a_plant_of_many_states_has_a_certified_design',
        'test_certified_is_never_worse_than_another_method',
        'test_reduction_drops_states_that_do_nothing',
        'test_thresholds_do_not_depend_on_units',
    ),
    '03-certified-below-unstructured': (
        'test_certified_is_never_worse_than_another_method',
        'test_certified_is_the_best_column',
        'test_two_inputs_are_no_worse_than_one',
        'test_another_input_does_not_raise_mu',
    ),
    '05-params-of-another-node-name': (
        'test_a_loop_runs_with_the_values_of_a_file_keyed_by_full_names',
        'test_a_file_keyed_by_the_names_of_another_namespace_is_refused',
        'test_a_node_gets_what_rcl_gives_it',
        'test_namespaces_may_be_nested',
        'test_what_no_node_would_get_is_refused_by_name',
        'test_each_node_has_its_own_values_and_the_tools_know_whose_count',
        'test_a_node_that_gets_nothing_from_its_file_warns_of_it',
        'test_a_node_starts_from_its_own_dump',
    ),
    '07-report-two-messages-out-of-order': (
        'test_messages_out_of_order_are_put_in_order',
        'test_messages_recorded_twice_count_once',
        'test_a_stream_is_the_same_whatever_the_order_of_neighbours',
        'test_the_last_of_two_runs_is_examined',
        'test_lost_messages_are_counted_where_they_are_missing',
    ),
    '08-report-of-a-32FC1-plant': (
        'test_luminosity_of_every_depth_is_a_signal',
        'test_an_image_of_another_size_is_left_out',
        'test_an_image_of_one_channel_is_its_luminosity',
        'test_colours_become_luma',
    ),
    '09-record-a-best-effort-camera': (
        'test_a_best_effort_camera_is_recorded_and_named_as_one',
        'test_a_publisher_that_appears_without_latching_is_recorded',
        'test_a_subscription_asks_for_what_every_publisher_offers',
        'test_a_late_subscriber_in_lockstep_gets_the_message_that_waits',
        'test_nodes_take_what_a_publisher_of_any_qos_offers_with_a_warning',
    ),
    '10-pictures-of-16-bits-and-floats': (
        'test_pictures_of_16_bits_and_floats_keep_their_ratios',
        'test_colours_of_16_bits',
        'test_black_of_a_colour_picture_is_less_than_half_a_grey_level',
        'test_mosaics_and_signed_integers_are_taken_as_they_are',
    ),
    '12-scene-of-60-pictures': (
        'test_scene_waits_for_subscribers_so_that_its_first_picture_is_not_lost',
        'test_scene_begins_at_once_with_no_wait',
        'test_play_waits_for_subscribers_and_ends_on_ctrl_c',
        'test_play_begins_at_once_with_no_wait',
    ),
    '13-video-of-25-frames-a-second': (
        'test_video_has_the_rate_of_its_file',
        'test_folder_brings_its_own_stamps',
        'test_stamps_that_do_not_fit_their_pictures_are_refused',
        'test_video_comes_at_its_own_rate_with_preview_and_figure',
        'test_numbered_pictures_come_in_the_order_of_their_numbers',
    ),
    '14-black-pixels-end-the-camera': (
        'test_pixel_without_light_starts_with_its_first_luminosity',
        'test_integer_images_may_be_black',
        'test_camera_without_a_stated_uncertainty_starts_with_any_picture',
        'test_black_pixels_of_a_float_image_hold_and_are_logged_once',
        'test_invalid_luminosity_is_counted_and_the_pixel_holds',
    ),
    '15-joint-names-in-another-order': (
        'test_entries_are_matched_by_name_and_not_by_position',
        'test_what_does_not_name_the_inputs_is_refused',
        'test_numbered_entries_are_found_by_name_whatever_their_order',
        'test_entries_with_other_names_stand_as_they_are',
        'test_a_joint_state_without_a_value_for_every_name_is_refused',
    ),
    '16-event-packets-of-real-drivers': (
        'test_every_encoding_gives_back_every_event_in_order',
        'test_evt3_keeps_its_time_and_row_from_packet_to_packet',
        'test_libcaer_rolls_over_within_a_packet',
        'test_bridge_takes_a_drivers_packets_and_sends_the_pixels_of_the_loop',
        'test_what_is_no_packet_is_refused_by_name',
    ),
    '17-encodings-of-usual-cameras': (
        'test_luma_of_interleaved_yuv',
        'test_luma_of_planar_yuv_whether_height_counts_the_chroma_or_not',
        'test_mosaics_and_signed_integers_are_taken_as_they_are',
        'test_unopened_cv_types_are_blue_green_red',
        'test_encoding_that_holds_no_luminosity_is_refused_by_its_name',
        'test_big_endian_and_padded_rows',
    ),
    '19-bag-of-a-remapped-loop': (
        'test_nodes_in_namespaces_of_their_own_are_one_loop',
        'test_topics_of_any_name_are_found_by_type_and_content',
        'test_of_two_cameras_one_has_to_be_named',
        'test_one_of_two_loops_is_chosen_by_its_namespace',
        'test_a_remapped_loop_runs',
    ),
    '20-ros1-bag': (
        'test_a_bag_of_ros_1',
        'test_event_arrays_are_the_bytes_that_rosbags_writes',
        'test_a_bag_of_two_cameras_asks_which',
        'test_messages_that_are_broken_are_left_out_and_counted',
    ),
    '21-sim-time-without-clock': (
        'test_a_clock_that_never_starts_is_named',
        'test_clocks_of_nodes_are_simulated_and_the_loop_runs_to_its_end',
        'test_a_clock_that_steps_starts_a_realtime_loop_again',
        'test_a_missing_partner_is_named',
    ),
    '22-no-period-is-short-enough': (
        'test_a_longer_period_is_unstable_and_a_shorter_one_stable',
        'test_tool_warns_of_a_period_that_is_too_long',
        'test_stable_plant_left_alone_needs_no_samples',
        'test_a_period_beyond_it_is_called_unstable',
        'test_below_the_longest_stable_period_a_fine_loop_decays_and_beyond_it_grows',
    ),
    '24-single-file-zstd': (
        'test_a_bag_of_ros_2_in_every_form',
        'test_a_single_file_without_metadata_is_enough',
        'test_a_bag_by_rosbag2_gives_the_same_run',
        'test_split_bags_without_metadata_are_read_in_natural_order',
        'test_a_recording_whose_metadata_name_no_storage_is_whole',
    ),
    '31-no-home': (
        'test_a_home_without_a_log_folder_is_named_with_the_remedy',
        'test_a_figure_is_the_same_whatever_is_set_around_it',
        'test_a_ros_from_apt_is_used_in_a_path_with_a_space_and_an_umlaut',
        'test_the_variable_that_keeps_ros_from_starting_is_named',
    ),
    '33-numba-disable-jit': (
        'test_whatever_the_settings_of_numba_the_events_are_the_same',
        'test_machine_without_numba_falls_back_or_names_the_package',
        'test_cache_of_compiled_kernels_that_is_broken_costs_one_line_and_no_result',
        'test_a_number_of_threads_that_numba_can_not_start_with_is_left_out',
    ),
    '36-units-of-luminosity-and-state': (
        'test_thresholds_do_not_depend_on_units',
        'test_structured_designs_exist_in_any_units',
        'test_the_answer_is_the_same_in_any_units',
        'test_integer_frames_give_the_events_of_the_same_floats',
    ),
    '37-backend-of-a-notebook': (
        'test_a_figure_is_the_same_whatever_is_set_around_it',
        'test_a_matplotlibrc_of_the_user_is_left_out',
        'test_matplotlib_is_loaded_in_one_place',
        'test_a_warning_of_a_library_ends_no_program_whatever_the_options_of_python',
    ),
    '39-hangup-while-recording': (
        'test_a_hang_up_closes_the_bag_that_is_recorded',
        'test_closed_loop_ends_on_a_signal',
        'test_a_closed_terminal_does_not_end_what_nohup_started',
        'test_a_second_signal_changes_nothing',
        'test_a_recorder_that_is_killed_leaves_all_but_the_last_second',
        'test_output_that_is_no_longer_read_ends_a_program_quietly',
    ),
    '41-clone-in-a-path-with-a-space': (
        'test_a_ros_from_apt_is_used_in_a_path_with_a_space_and_an_umlaut',
        'test_a_missing_index_is_named',
        'test_a_full_disk_is_named',
        'test_missing_venv_is_named',
    ),
    '42-clock-steps-forward': (
        'test_a_clock_that_steps_starts_a_realtime_loop_again',
        'test_five_samples_that_follow_each_other_are_a_step_of_the_clock',
        'test_one_outlier_is_refused_and_the_stream_goes_on',
        'test_a_clock_that_jumps_by_a_year_does_not_fill_the_memory_with_noise',
        'test_a_ros_clock_that_is_set_back_is_followed_at_once',
    ),
    '45-interrupt-a-sweep': (
        'test_ctrl_c_keeps_the_rows_and_prints_one_line',
        'test_a_killed_sweep_goes_on_and_counts_nothing_twice',
        'test_a_finished_sweep_starts_no_cluster',
        'test_a_signal_during_the_imports_ends_a_program_in_order',
    ),
    '46-step-at-a-fine-threshold': (
        'test_flood_is_refused_before_it_fills_the_memory_and_the_next_sample_starts_anew',
        'test_camera_starts_again_and_logs_why',
        'test_refractory_pixels_have_no_flood',
        'test_day_of_silence_costs_one_packet',
    ),
    '47-domain-that-is-none': (
        'test_a_domain_that_is_none_is_refused_in_one_line',
        'test_a_domain_that_is_none_is_refused',
        'test_a_domain_of_ros_is_taken_as_ros_reads_it',
        'test_a_loop_whose_nodes_can_not_find_each_other_is_refused',
        'test_the_variable_that_keeps_ros_from_starting_is_named',
    ),
    '53-disk-full-for-the-tools': (
        'test_a_full_device_is_named',
        'test_a_draft_that_fails_leaves_everything_as_it_was',
        'test_a_full_disk_is_named_and_leaves_nothing_useless',
        'test_a_full_disk_names_the_table',
        'test_a_full_disk_ends_a_recording_with_an_error',
        'test_output_onto_a_full_disk_is_one_line',
        'test_a_full_shared_memory_is_named_and_ends_no_program_by_a_bus_error',
    ),
}


def existing():
    files = [*ROOT.glob('test/test_*.py'), *ROOT.glob('src/*/test/test_*.py')]
    text = '\n'.join(file.read_text(encoding='utf-8') for file in files)
    return set(re.findall(r'^def (test_\w+)', text, re.MULTILINE))


def test_every_case_has_three_relatives_or_more_among_the_tests():
    there = existing()

    assert len(RELATIVES) == 30
    for case, tests in RELATIVES.items():
        assert len(set(tests)) >= 3, case
        assert set(tests) <= there, (case, set(tests) - there)


@pytest.mark.skipif(not CASES.is_dir(), reason='the cases are not at hand')
def test_no_case_is_without_relatives():
    numbers = {folder.name[:2] for folder in CASES.iterdir() if folder.is_dir()}

    assert numbers == {case[:2] for case in RELATIVES}
